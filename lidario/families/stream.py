"""What the session must know of a stream: of one that was just started, or of one among recorded bytes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from lidario.families.samples import Decoder
from lidario.model import ScanMode
from lidario.wire.blocks import Block
from lidario.wire.envelope import Request
from lidario.wire.formats import StreamFormat

ENDLESS_TURNS: Final = 4
"""Times that the slowest revolution takes, after which one that has not ended is given up. A rotor that runs down
is slower than it ever should be."""
LONGEST_REVOLUTION: Final = 65536
"""Samples after which a revolution that does not end is given up, whatever is said of its times; twice what the
fastest device takes at its slowest speed."""

_BITS_A_BYTE: Final = 10


@dataclass(frozen=True, slots=True)
class Keepalive:
    """A request that must be repeated while a stream runs."""

    request: Request  # what to send
    interval_s: float  # how often


@dataclass(frozen=True, slots=True)
class Stream:
    """All the session must know of a stream that was just started."""

    format: StreamFormat  # the packet format, the same object that the starting request carried
    decoder: Decoder  # what makes samples of its packets
    mode: ScanMode  # the scan mode that runs
    sample_ns: float  # nanoseconds a sample; 0 when the device does not say
    spin_up_s: float  # longest time until the first packet may be expected
    slowest_turn_s: float  # longest time one revolution may take
    keepalive: Keepalive | None = None  # what must be repeated meanwhile, if anything
    zero_offset_deg: float = 0.0  # degrees to add to every device angle
    # Nanoseconds that a sample may take, where `sample_ns` is 0: which one holds is measured.
    may_take_ns: tuple[float, ...] = ()
    # Whether its packets come when they are measured, or soon after; False where they were stored without times,
    # which are made from the samples then.
    timed: bool = True

    @property
    def most_ns(self) -> float:
        """Nanoseconds that a revolution may take, before it is given up (`ENDLESS_TURNS`)."""
        return ENDLESS_TURNS * 1e9 * self.slowest_turn_s

    @property
    def most_bytes(self) -> int:
        """Bytes of packets that a revolution may have, before it is given up (`ENDLESS_TURNS`).

        Times come from the device, a peer or a file. Whatever they say, it is never more than `LONGEST_REVOLUTION`
        samples.
        """
        samples = float(LONGEST_REVOLUTION)
        if self.sample_ns:
            samples = min(samples, self.most_ns / self.sample_ns)
        wire = self.format
        sizes = [(size, wire.samples_in((Block(size, 1),))) for size in (wire.shortest, wire.longest)]
        most = max(math.ceil(samples / max(each, 1)) * size for size, each in sizes)
        # The last packet is there before it is seen that it is too much.
        return most + wire.longest

    def speed_on(self, baudrate: int) -> int:
        """Speed of the line in bits a second: `baudrate`, or 0 where packets are more than that could carry.

        Then it means nothing, as for a device that is a USB device itself. Only packets that are whole scans tell.
        """
        wire, turn_s = self.format, self.format.pitch * self.sample_ns * 1e-9
        return 0 if wire.whole and wire.shortest * _BITS_A_BYTE > baudrate * turn_s else baudrate


class Known(NamedTuple):
    """What a user says of bytes that were recorded without times."""

    family: str | None = None  # short name of the family; None to tell it from the bytes, or by the model
    model: str | None = None  # one of `Family.models`; None to tell it from the bytes
    # Microseconds a sample; None for what the bytes tell, or the model or format usually takes.
    sample_us: float | None = None


class RawStream(NamedTuple):
    """A measurement stream among bytes that were recorded without times."""

    begin: int  # offset of its first byte, behind its descriptor
    stream: Stream  # what it is
    title: str = ""  # the model, for people; empty where neither the bytes nor the user told it
    guess: str = ""  # what the model was taken for, and what else it may be; empty where nothing had to be guessed


def raw_stream(
    begin: int,
    wire: StreamFormat,
    decoder: Decoder,
    sample_us: float,
    title: str = "",
    guess: str = "",
    response_type: int | None = None,
    details: str = "",
) -> RawStream:
    """A recorded stream of which nothing is known but its format, the time of a sample, and perhaps the model.

    `response_type` is that by which `Family.stream_in` knows it, where it is not the one of the format, and
    `details` what else that must know.
    """
    stream = Stream(
        format=wire,
        decoder=decoder,
        # The device's own name of the mode is not among the bytes.
        mode=ScanMode(0, wire.name, sample_us, 0.0, response_type or wire.response_type, details=details),
        sample_ns=sample_us * 1e3,
        spin_up_s=0.0,
        slowest_turn_s=LONGEST_REVOLUTION * sample_us * 1e-6,
        timed=False,
    )
    return RawStream(begin, stream, title, guess)
