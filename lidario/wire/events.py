"""The three kinds of event that `Link` reports, as plain data.

Events do not depend on how the bytes were divided into chunks, with one exception: packets that follow each other
may be reported in one `Packets` or in several. Noise makes no event; it is counted in `LinkStats`.
"""

from bisect import bisect_right
from dataclasses import dataclass
from operator import itemgetter
from typing import Final, TypeAlias

from lidario.wire.blocks import Block

Arrival: TypeAlias = tuple[int, int]
"""How much had come, and when: a number of bytes or of packets, and the time in the caller's nanoseconds."""

EARLIEST_NS: Final = -(1 << 63)
"""A time before all others."""


@dataclass(frozen=True, slots=True)
class Descriptor:
    """The device announced a measurement stream; packets follow until it is stopped."""

    # Response type, e.g. 0x85.
    type: int
    size: int  # length of one packet in bytes, as the device claims it
    continuous: bool  # True for a stream, False for a single response


@dataclass(frozen=True, slots=True)
class Response:
    """The single response to the pending request."""

    payload: bytes  # the bytes after the descriptor


# Not frozen: creating a frozen object takes three times as long, and one is created for every read.
@dataclass(slots=True)
class Packets:
    """A run: at least one intact packet of the stream's format; several packets follow each other on the wire.

    Nobody changes a run after it was made.
    """

    data: bytes  # the packets, back to back
    blocks: tuple[Block, ...]  # sizes of the packets: neighbours of one size together
    # When the packets came: pairs ``(packets, at_ns)``, so many were complete at that time; ascending. The last
    # pair is for all packets. There is more than one pair only if packets were collected from several reads.
    arrivals: tuple[Arrival, ...]
    # Bytes that belong to no packet: pairs ``(number, bytes)``, so many right before packet `number`; ascending.
    # Only joined runs have such bytes behind the first packet.
    skips: tuple[tuple[int, int], ...] = ()
    # True if the first packet was complete with one read, but recognised only with a later one, by the bytes behind
    # it, because there is damage before it. The packets before the damage were dated without it.
    apart: bool = False
    # True if the read that brought the last packet also brought later ones. Its arrival is then computed, as if no
    # packet were missing between.
    cut: bool = False

    @property
    def count(self) -> int:
        """How many packets there are."""
        return self.arrivals[-1][0]

    @property
    def skipped(self) -> int:
        """Bytes that belong to no packet, right before the first packet."""
        return self.skips[0][1] if self.skips and not self.skips[0][0] else 0

    @property
    def received_ns(self) -> int:
        """Arrival of the read that completed the last packet."""
        return self.arrivals[-1][1]

    def read_at(self, number: int) -> int:
        """Arrival of the read that completed packet `number`, from 0."""
        return self.arrivals[bisect_right(self.arrivals, number, key=itemgetter(0))][1]


Event = Descriptor | Response | Packets
