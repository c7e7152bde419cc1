"""Checks and dates the packets that come: each packet once, at its time. Also finds how long a sample takes."""

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
        """Whether packets carry the device's clock, so that no time is late. The time of a read may be late."""
        ...

    def dated(self, packets: Packets) -> Packets:
        """The next packets, with the times at which they came."""
        ...


class Incoming:
    """Follows one stream.

    Args:
        stream: The stream.
        stats: Counts the packets that came twice, that are false, or that wait.
        clock: Dates the packets; by default the device's clock, if packets carry it.
    """

    def __init__(self, stream: Stream, stats: AssemblerStats, clock: Clock | None = None) -> None:
        # How long a sample takes.
        self.time: SampleTime = SampleTime(stream.sample_ns, stream.may_take_ns, timed=stream.timed)
        self.passing: list[int] | None = None  # result of `FalsePackets.passing` for the latest packets
        self._format = stream.format
        self._doubled = DoubledPackets(stream.format, stream.sample_ns, stats)
        self._false = FalsePackets(stream, stats)
        self.is_live: bool = clock is None and stream.timed  # whether time goes on while packets are missing
        self._is_timed = stream.timed
        self._clock: Clock = clock or DeviceClock(stream)
        # Times of the device's clock are never late, nor are times made from samples.
        self._pauses = Pauses(stream, stats) if self.is_live and not self.is_exact else None

    def take(self, event: Packets, turn_ns: float = 0.0) -> tuple[Packets, Headings] | None:
        """The next packets, dated, and their headings, without false and doubled ones. None if none is left.

        `turn_ns` is the time of a revolution, or 0 if unknown: packets that are late by about as much may wait.
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
            # Each packet is ahead of the one before, so none came twice.
            self._doubled.before, self._doubled.alike = event, 1
            return self._clock.dated(event), headings
        event, headings = self._doubled.drop(event, headings)
        event, headings = self._false.drop(event, headings) if event.data else (event, headings)
        return (self._clock.dated(event), headings) if event.data else None

    def end(self) -> tuple[tuple[Packets, Headings] | None, Packets | None]:
        """The stream has ended: release the packets that wait, as `take`, and the one that may be false.

        Nothing showed that the line was late. The last packet is taken as true.
        """
        waited = None if self._pauses is None else self._pauses.left()
        late = None if waited is None else self._true(waited)
        return late, self._false.left()

    def read_at(self, event: Packets, number: int) -> int:
        """Arrival of the read that completed packet `number`; 0 if times were made from the samples."""
        return event.read_at(number) if self._is_timed else 0

    @property
    def is_exact(self) -> bool:
        """Whether the device's clock gives the times, so that none is late."""
        return self._clock.is_told

    def measure(self, samples: Samples, packets: Packets) -> None:
        """Use the samples that `packets` were decoded to for the time of a sample."""
        if samples.certain and not samples.sample_ns:
            measured = samples.ends[-1] + sum([skipped for _, skipped in samples.gaps])
            self.time.add(measured, packets.arrivals[-1][1])
            self.time.suppose(samples.last.samples, samples.last.reported_rpm)
        else:
            self.time.restart()

    def use_time_of(self, stream: Stream) -> None:
        """From now on use the sample time of `stream`."""
        self._doubled.tell_time(stream.sample_ns)
        self._false.tell_time(stream.sample_ns)
        if self.is_live:
            self._clock = DeviceClock(stream)
