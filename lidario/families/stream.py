"""Describes a stream for the session: one that was just started, or one among recorded bytes."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from lidario.basics.model import ScanMode
from lidario.families.samples import Decoder
from lidario.wire.blocks import Block
from lidario.wire.envelope import Request
from lidario.wire.formats import StreamFormat

ENDLESS_TURNS: Final = 4
"""A revolution that has not ended after this many times the slowest one is given up. Not earlier, because a rotor
that runs down is slower than it ever should be."""
LONGEST_REVOLUTION: Final = 65536
"""A revolution that has not ended after this many samples is given up, whatever its times say. This is twice as
many as the fastest device measures at its slowest speed."""

_BITS_A_BYTE: Final = 10


@dataclass(frozen=True, slots=True)
class Keepalive:
    """A request that must be repeated while a stream runs."""

    request: Request  # what to send
    interval_s: float  # how often


@dataclass(frozen=True, slots=True)
class Stream:
    """All that the session must know about a stream that was just started."""

    format: StreamFormat  # the packet format, the same object that the starting request carried
    decoder: Decoder  # makes samples of its packets
    mode: ScanMode  # the scan mode that runs
    sample_ns: float  # nanoseconds a sample; 0 if the device does not say
    spin_up_s: float  # longest time until the first packet may be expected
    slowest_turn_s: float  # longest time one revolution may take
    keepalive: Keepalive | None = None  # the request to repeat while it runs, if any
    zero_offset_deg: float = 0.0  # degrees to add to every device angle
    # Possible nanoseconds a sample, if `sample_ns` is 0: measuring shows which of them is right.
    may_take_ns: tuple[float, ...] = ()
    # Whether its packets come when they are measured, or soon after. False if they were stored without times, which
    # are then made from the samples.
    timed: bool = True

    @property
    def most_ns(self) -> float:
        """Nanoseconds after which a revolution is given up (`ENDLESS_TURNS`)."""
        return ENDLESS_TURNS * 1e9 * self.slowest_turn_s

    @property
    def most_bytes(self) -> int:
        """Bytes of packets after which a revolution is given up (`ENDLESS_TURNS`).

        Times come from the device, a peer or a file. Whatever they say, a revolution never has more than
        `LONGEST_REVOLUTION` samples.
        """
        samples = float(LONGEST_REVOLUTION)
        if self.sample_ns:
            samples = min(samples, self.most_ns / self.sample_ns)
        wire = self.format
        sizes = [(size, wire.samples_in((Block(size, 1),))) for size in (wire.shortest, wire.longest)]
        most = max(math.ceil(samples / max(each, 1)) * size for size, each in sizes)
        # One packet more: it is there before it is seen to be too much.
        return most + wire.longest

    def speed_on(self, baudrate: int) -> int:
        """Speed of the line in bits a second: `baudrate`, or 0 if a line of that speed could not carry the packets.

        Then the speed means nothing, as for a device that is a USB device itself. Only packets that are whole scans
        show this.
        """
        wire, turn_s = self.format, self.format.pitch * self.sample_ns * 1e-9
        return 0 if wire.whole and wire.shortest * _BITS_A_BYTE > baudrate * turn_s else baudrate


class Known(NamedTuple):
    """What a user says about bytes that were recorded without times."""

    family: str | None = None  # short name of the family; None to find it by the bytes or the model
    model: str | None = None  # one of `Family.models`; None to find it by the bytes
    # Microseconds a sample; None to use what the bytes tell, or else what the model or format usually takes.
    sample_us: float | None = None


class RawStream(NamedTuple):
    """A measurement stream among bytes that were recorded without times."""

    begin: int  # offset of its first byte, behind its descriptor
    stream: Stream  # the stream
    title: str = ""  # the model, for people; empty if neither the bytes nor the user told it
    guess: str = ""  # what the model was taken for, and what else it may be; empty if nothing had to be guessed


def runs_in(data: memoryview, wire: StreamFormat, packets: int) -> Iterator[tuple[int, bytearray]]:
    """The places in recorded bytes where an intact packet begins, each with the bytes of so many `packets`."""
    for found in wire.header.finditer(data):
        at = found.start()
        run = bytearray(data[at : at + packets * wire.longest])
        if wire.run(run, 0).packets:
            yield at, run


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
    """A recorded stream of which only the format, the time of a sample, and perhaps the model are known.

    `response_type` is the type by which `Family.stream_in` finds it, if it is not that of the format; `details` is
    what else `Family.stream_in` needs.
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
