"""What the session must know of a stream: of one that was just started, or of one among recorded bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

from lidario.families.samples import Decoder
from lidario.model import ScanMode
from lidario.wire.envelope import Request
from lidario.wire.formats import StreamFormat

__all__ = ["Keepalive", "RawStream", "Stream", "raw_stream"]


@dataclass(frozen=True, slots=True)
class Keepalive:
    """A request that must be repeated while a stream runs.

    Attributes:
        request: What to send.
        interval_s: How often.
    """

    request: Request
    interval_s: float


@dataclass(frozen=True, slots=True)
class Stream:
    """All the session must know of a stream that was just started.

    Attributes:
        format: The packet format, the same object that the starting request carried.
        decoder: What makes samples of its packets.
        mode: The scan mode that runs.
        sample_ns: Nanoseconds a sample; 0 when the device does not say.
        spin_up_s: Longest time until the first packet may be expected.
        slowest_turn_s: Longest time one revolution may take.
        keepalive: What must be repeated meanwhile, if anything.
        zero_offset_deg: Degrees to add to every device angle.
    """

    format: StreamFormat
    decoder: Decoder
    mode: ScanMode
    sample_ns: float
    spin_up_s: float
    slowest_turn_s: float
    keepalive: Keepalive | None = None
    zero_offset_deg: float = 0.0


class RawStream(NamedTuple):
    """A measurement stream among bytes that were recorded without times.

    Attributes:
        begin: Offset of its first byte, behind its descriptor.
        stream: What it is.
    """

    begin: int
    stream: Stream


_LONGEST_REVOLUTION: Final = 65536
"""Samples after which a recorded revolution that does not end is given up; several times what any device takes."""


def raw_stream(begin: int, wire: StreamFormat, decoder: Decoder, sample_us: float) -> RawStream:
    """A recorded stream of which nothing is known but its format and the time of a sample."""
    stream = Stream(
        format=wire,
        decoder=decoder,
        # The device's own name of the mode is not among the bytes.
        mode=ScanMode(0, wire.name, sample_us, 0.0, wire.response_type),
        sample_ns=sample_us * 1e3,
        spin_up_s=0.0,
        slowest_turn_s=_LONGEST_REVOLUTION * sample_us * 1e-6,
    )
    return RawStream(begin, stream)
