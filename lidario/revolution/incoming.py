"""What comes, before revolutions are made of it: each packet once, at its time; and how long a sample takes."""

from __future__ import annotations

from typing import Protocol

from lidario.families.base import Samples, Stream
from lidario.revolution.device_clock import DeviceClock
from lidario.revolution.doubled import DoubledPackets
from lidario.revolution.false_packets import FalsePackets
from lidario.revolution.pauses import Pauses
from lidario.revolution.sample_time import SampleTime
from lidario.revolution.stats import AssemblerStats
from lidario.wire.events import Packets
from lidario.wire.formats import Headings


class Clock(Protocol):
    """Tells when packets came."""

    @property
    def is_told(self) -> bool:
        """Whether packets carry the device's clock, so that no time is late, as that of a read may be."""
        ...

    def dated(self, packets: Packets) -> Packets:
        """The next packets, with the times at which they came."""
        ...


class Incoming:
    """Follows one stream.

    Args:
        stream: The stream.
        stats: Where packets are counted that came twice, and false ones.
        clock: What dates the packets; by default the device's clock, where they carry one.
    """

    def __init__(self, stream: Stream, stats: AssemblerStats, clock: Clock | None = None) -> None:
        # How long a sample takes.
        self.time: SampleTime = SampleTime(stream.sample_ns, stream.may_take_ns, timed=stream.timed)
        self.passing: list[int] | None = None  # as `FalsePackets.passing`, of the latest packets
        self._format = stream.format
        self._doubled = DoubledPackets(stream.format, stream.sample_ns, stats)
        self._false = FalsePackets(stream, stats)
        self.is_live: bool = clock is None and stream.timed  # whether time goes on while packets are missing
        self._is_timed = stream.timed
        self._clock: Clock = clock or DeviceClock(stream)
        # Neither times that are told nor those that were made from samples are late.
        self._pauses = Pauses(stream, stats) if self.is_live and not self.is_exact else None

    def take(self, event: Packets, turn_ns: float = 0.0) -> tuple[Packets, Headings] | None:
        """The next packets and their headings: none false, none twice, and dated. None where none is left.

        `turn_ns` is what a revolution takes, or 0: what comes late by as much may wait.
        """
        if self._pauses is not None:
            come = self._pauses.take(event, self.time.known_ns, turn_ns)
            if come is None:
                return None
            event = come
        return self._true(event)

    def _true(self, event: Packets) -> tuple[Packets, Headings] | None:
        headings = self._format.headings(event)
        self.passing = self._false.passing(headings, event.skips)
        if self.passing is not None:
            # None came twice either.
            self._doubled.before, self._doubled.alike = event, 1
            return self._clock.dated(event), headings
        event, headings = self._doubled.drop(event, headings)
        event, headings = self._false.drop(event, headings) if event.data else (event, headings)
        return (self._clock.dated(event), headings) if event.data else None

    def late(self) -> tuple[Packets, Headings] | None:
        """As `take`, the packets that wait, where the stream has ended: nothing shows that the line was late."""
        waited = None if self._pauses is None else self._pauses.left()
        return None if waited is None else self._true(waited)

    def odd(self) -> Packets | None:
        """The packet that waits, since it may be false, where the stream has ended: it is taken for true."""
        return self._false.left()

    def read_at(self, event: Packets, number: int) -> int:
        """When the read came that completed packet `number`; 0 where times were made from the samples."""
        return event.read_at(number) if self._is_timed else 0

    @property
    def is_exact(self) -> bool:
        """Whether no time is late: the device tells it."""
        return self._clock.is_told

    def measure(self, samples: Samples, packets: Packets) -> None:
        """These packets were decoded to those samples."""
        if samples.certain and not samples.sample_ns:
            measured = samples.ends[-1] + sum([skipped for _, skipped in samples.gaps])
            self.time.add(measured, packets.arrivals[-1][1])
            self.time.suppose(samples.last.samples, samples.last.reported_rpm)
        else:
            self.time.restart()

    def use_time_of(self, stream: Stream) -> None:
        """A sample takes as long as this stream says from now on."""
        self._doubled.tell_time(stream.sample_ns)
        self._false.tell_time(stream.sample_ns)
        if self.is_live:
            self._clock = DeviceClock(stream)
