"""The heads of packets: where the rotor stood at each, and how far ahead the next packet is."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidario.wire.events import Arrival

Ints: TypeAlias = NDArray[np.int32]
Arc: TypeAlias = NDArray[np.int32] | NDArray[np.float64]

RETREAT_TURNS: Final = 1 / 36
"""Packets with a check value fall back by this at most. What falls back farther went the long way round."""
LIKENESS: Final = 0.2
"""Two arcs that differ by less than this share are one speed. Neighbours differ by less, half a gap by more."""
SPANS_WORTH_AN_ARRAY: Final = 160
"""From this many spans on, numpy finds the least, the greatest and the sum. Measured: a list takes 0.06 us a span,
an array 2.5 us; live, where numpy is cold once a revolution, they take 11 and 29 us for 80 spans."""


class Heads(NamedTuple):
    """The angles of packets that follow each other, in heading units; arrays of shape (packets,)."""

    first: Ints  # the angle of the first sample of each packet
    following: int | None  # the angle of the packet behind them; None if unknown
    counts: Ints | int  # samples of each packet; one number if all packets have as many
    way: Ints | None = None  # angle from the first sample of each packet to its last, if packets tell it; else None
    read: Any = None  # whatever else the decoder has read of the packets

    @property
    def samples(self) -> int:
        """Samples of all packets."""
        if isinstance(self.counts, int):
            return self.counts * len(self.first)
        return int(np.add.reduce(self.counts))

    def count_of(self, packet: int) -> int:
        """Samples of one packet."""
        return self.counts if isinstance(self.counts, int) else int(self.counts[packet])


class Arcs(NamedTuple):
    """How the rotor turned during packets that follow each other, and what is missing behind each."""

    # Rotation during each packet, in heading units: up to the first sample of the next one or, if packets tell
    # their own way, up to their last sample.
    arc: Arc
    skipped: NDArray[np.intp] | None  # samples missing behind each packet, an array; None if none are
    # The mean rotation from sample to sample, in heading units; 0 if unknown. With several revolutions, that of the
    # last one.
    step: float
    certain: bool  # whether the speed is sure
    # A correction of earlier results, because of what time shows now: ``(missing, packets)``, so many packets are
    # missing behind each of the last `packets`, which were reported to follow each other. ``(1, 0)``: only the
    # samples of the last packet before are not to be used.
    revoked: tuple[int, int] = (0, 0)
    # Whether each span is a whole number of arcs, as far as it shows that; if one is not, a turn may hide in it.
    fits: bool = True
    steps: Sequence[float] = ()  # the mean step of each revolution, if several were followed


class Turning(ABC):
    """Follows the rotor through one stream, by the heads of its packets. By default it remembers nothing."""

    def tell_time(self, sample_ns: float, *, passes: bool = True) -> None:  # noqa: B027
        """Take note of how long a sample takes, as `Decoder.tell_time`."""

    def doubt_time(self) -> None:  # noqa: B027
        """The latest arrival was computed, not measured (`Packets.cut`): the next one shall replace it."""

    def copy(self) -> Self:
        """An independent copy, which goes on from here."""
        return self

    @abstractmethod
    def follow(self, heads: Heads, arrivals: Sequence[Arrival] = ()) -> Arcs:
        """The arc of each of the next packets, and the gaps behind them; `arrivals` as in `Packets`."""

    def follow_several(
        self,
        heads: Heads,  # noqa: ARG002
        ends: Sequence[int],  # noqa: ARG002
        arrivals: Sequence[Arrival] = (),  # noqa: ARG002
    ) -> Arcs | None:
        """The arcs of several revolutions, if `follow` would find nothing missing in any of them; else None.

        Also None if the times of several reads may still show how many packets an arc is. With None, nothing is
        remembered. The packet behind the last one must be known; `ends` are packets up to the end of each
        revolution.
        """
        return None


def spans_between(heads: Heads, full_turn: int, retreat: int) -> tuple[Ints, int, int, int]:
    """How far ahead of each packet the next one is, 0 if none follows; also the least, the greatest and the sum.

    A heading that falls back by more than `retreat` has gone the long way round, forwards.
    """
    first, following = heads.first, heads.following
    spans = np.empty(len(first), first.dtype)
    np.subtract(first[1:], first[:-1], out=spans[:-1])
    last = 0 if following is None else following - int(first[-1])
    # Mostly, the angles pass 0 only at this last span.
    spans[-1] = last + full_turn if last < -retreat else last
    least, greatest, total = extent(spans)
    if least < -retreat:
        np.add(spans, full_turn, out=spans, where=spans < -retreat)
        least, greatest, total = extent(spans)
    if greatest >= full_turn - retreat:
        np.subtract(spans, full_turn, out=spans, where=spans >= full_turn - retreat)
        least, greatest, total = extent(spans)
    return spans, least, greatest, total


def by_revolution(spans: Ints, ends: Sequence[int]) -> list[tuple[int, int, int]]:
    """The least, the greatest and the sum of the spans of each revolution."""
    begins = [0, *ends[:-1]]
    return list(
        zip(
            np.minimum.reduceat(spans, begins).tolist(),
            np.maximum.reduceat(spans, begins).tolist(),
            np.add.reduceat(spans, begins, dtype=np.int64).tolist(),
            strict=True,
        )
    )


def are_alike(arc: float, shortest: int, longest: int) -> bool:
    """Whether all spans of a revolution are like the arc before."""
    return (1 - LIKENESS) * arc <= shortest and longest <= (1 + LIKENESS) * arc


def largest_group(spans: Sequence[int]) -> tuple[float, int]:
    """Mean and size of the largest group of sorted spans that agree; of equal groups, of the shorter spans."""
    best = begin = place = 0
    for end in range(len(spans)):
        while spans[end] > (1 + LIKENESS / 2) * spans[begin]:
            begin += 1
        if end + 1 - begin > best:
            best, place = end + 1 - begin, begin
    return sum(spans[place : place + best]) / best, best


def extent(values: Ints) -> tuple[int, int, int]:
    """The least, the greatest and the sum of values."""
    if len(values) < SPANS_WORTH_AN_ARRAY:
        plain = values.tolist()
        return min(plain), max(plain), sum(plain)
    return int(np.minimum.reduce(values)), int(np.maximum.reduce(values)), int(np.add.reduce(values))
