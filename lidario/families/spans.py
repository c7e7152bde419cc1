"""What the heads of packets tell: where the rotor stood, and how far ahead the next packet is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidario.wire.events import Arrival

Ints: TypeAlias = NDArray[np.int32]
Arc: TypeAlias = NDArray[np.int32] | NDArray[np.float64]

RETREAT_TURNS: Final = 1 / 36
"""How far packets under a check value fall back at most. Any more is the long way round, forwards."""
LIKENESS: Final = 0.2
"""Two arcs within this share of each other are one speed: neighbours differ by less, half a gap is farther off."""
SPANS_WORTH_AN_ARRAY: Final = 160
"""Spans from which numpy finds the least, the greatest and their sum. Measured: a list takes 0.06 us for each, an
array 2.5 us; live, where numpy is cold once a revolution, they take 11 and 29 us for 80 spans."""


class Heads(NamedTuple):
    """Where packets that follow each other stand, in heading units; arrays of shape (packets,)."""

    first: Ints  # the angle of the first sample of each
    following: int | None  # that of the packet behind them; None where it is not known
    counts: Ints | int  # samples of each; one number where all packets have as many
    way: Ints | None = None  # from the first sample of each to its last, where packets tell that; else None
    read: Any = None  # what else the decoder has read of them

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
    """What is known of packets that follow each other."""

    # Rotation during each packet, in heading units: up to the first sample of the next one, or, where packets tell
    # their own, up to the last sample.
    arc: Arc
    skipped: NDArray[np.intp] | None  # samples missing behind each, an array; None when none is
    # The mean rotation from sample to sample, in heading units; 0 when nothing is known. Of several revolutions,
    # that of the last one.
    step: float
    certain: bool  # whether the speed is sure
    # How many packets are missing behind each of so many before, which were told to follow each other, as time
    # tells now; ``(1, 0)`` where only what the last one measured is not to be used.
    revoked: tuple[int, int] = (0, 0)
    # Whether each span is a whole number of arcs, as far as it tells; where one is not, a turn may hide.
    fits: bool = True
    steps: Sequence[float] = ()  # the mean step of each revolution, where several were followed


class Turning(ABC):
    """Follows the rotor through one stream, by the heads of its packets. By default it remembers nothing."""

    def tell_time(self, sample_ns: float, *, passes: bool = True) -> None:  # noqa: B027
        """As `Decoder.tell_time`."""

    def doubt_time(self) -> None:  # noqa: B027
        """The time that was told last was reckoned (`Packets.cut`): the next one takes its place."""

    def copy(self) -> Self:
        """Another one, which goes on from here without changing what this one remembers."""
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
        """The arcs of several revolutions, where `follow` would find nothing missing in any.

        None otherwise, also where the times of several reads may yet tell how many packets an arc is. Then nothing
        is remembered. The packet behind all of them is known; `ends` are packets up to the end of each revolution.
        """
        return None


def spans_between(heads: Heads, full_turn: int, retreat: int) -> tuple[Ints, int, int, int]:
    """How far ahead of each packet the next one is, 0 where none follows; the least, the greatest and their sum.

    A heading that falls back by more than `retreat` has gone the long way round, forwards.
    """
    first, following = heads.first, heads.following
    spans = np.empty(len(first), first.dtype)
    np.subtract(first[1:], first[:-1], out=spans[:-1])
    last = 0 if following is None else following - int(first[-1])
    # Mostly it is only here that the angles pass 0.
    spans[-1] = last + full_turn if last < -retreat else last
    least, greatest, total = _extent(spans)
    if least < -retreat:
        np.add(spans, full_turn, out=spans, where=spans < -retreat)
        least, greatest, total = _extent(spans)
    if greatest >= full_turn - retreat:
        np.subtract(spans, full_turn, out=spans, where=spans >= full_turn - retreat)
        least, greatest, total = _extent(spans)
    return spans, least, greatest, total


def by_revolution(spans: Ints, ends: Sequence[int]) -> list[tuple[int, int, int]]:
    """The least and the greatest of the spans of each revolution, and their sum."""
    begins = [0, *ends[:-1]]
    return list(
        zip(
            np.minimum.reduceat(spans, begins).tolist(),
            np.maximum.reduceat(spans, begins).tolist(),
            np.add.reduceat(spans, begins, dtype=np.int64).tolist(),
            strict=True,
        )
    )


def _extent(values: Ints) -> tuple[int, int, int]:
    if len(values) < SPANS_WORTH_AN_ARRAY:
        plain = values.tolist()
        return min(plain), max(plain), sum(plain)
    return int(np.minimum.reduce(values)), int(np.maximum.reduce(values)), int(np.add.reduce(values))
