"""What `Link` reports: three kinds of event, each plain data.

Events do not depend on how the bytes were divided into chunks, but for one freedom: packets that follow each other
may be reported in one `Packets` or in several. Noise makes no event; it is counted in `LinkStats`.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from operator import itemgetter
from typing import Final, TypeAlias

from lidario.wire.blocks import Block

Arrival: TypeAlias = tuple[int, int]
"""How much had come, and when: a number of bytes or of packets, and the time in the caller's nanoseconds."""

EARLIEST_NS: Final = -(1 << 63)
"""Before all times that are told."""


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


# Not frozen: creating a frozen one takes three times as long, and one is created for every read.
@dataclass(slots=True)
class Packets:
    """At least one intact packet of the stream's format; several of them follow each other on the wire.

    Nobody changes one that was made.
    """

    data: bytes  # the packets, back to back
    blocks: tuple[Block, ...]  # their sizes: neighbours of one size together
    # When they came: pairs ``(packets, at_ns)``, so many of them were complete at that time; ascending, the last
    # pair is for all of them. More than one pair only when they were collected from several reads.
    arrivals: tuple[Arrival, ...]
    # Where bytes stand that belong to no packet: pairs ``(number, bytes)``, so many right before packet `number`;
    # ascending. Behind the first packet only where several runs were joined.
    skips: tuple[tuple[int, int], ...] = ()
    # True when the first one was complete with one read, and told only with a later one: by the bytes behind it,
    # since damage stands before it. What was read with it was dated without it.
    apart: bool = False
    # True when others came with the last of them. When those here were complete is then reckoned, as if nothing
    # were missing between.
    cut: bool = False

    @property
    def count(self) -> int:
        """How many packets there are."""
        return self.arrivals[-1][0]

    @property
    def skipped(self) -> int:
        """Bytes that belong to no packet, between the packet before and the first of these."""
        return self.skips[0][1] if self.skips and not self.skips[0][0] else 0

    @property
    def received_ns(self) -> int:
        """Arrival of the read that completed the last of them."""
        return self.arrivals[-1][1]

    def read_at(self, number: int) -> int:
        """Arrival of the read that completed packet `number`, from 0."""
        return self.arrivals[bisect_right(self.arrivals, number, key=itemgetter(0))][1]


Event = Descriptor | Response | Packets
