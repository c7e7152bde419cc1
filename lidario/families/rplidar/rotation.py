"""How far the rotor turned during each packet, and how many packets are missing.

A packet states where it begins but not where it ends: that is where the next one begins. Dividing the arc
between two packets by the samples of one is right only when the second really followed the first. After a loss
the vendor's SDK stretches the samples over the whole gap. Here the arc of an ordinary packet is known from the
neighbours, so the number of missing packets is too, and each packet gets its own share of the arc.

What is ordinary has to be learned first, and the first spans of a stream may be gaps. So all spans are kept until
enough of them agree; only then is the arc certain, and judges those that come. Where packets hold the angle of each
sample, the arc is known from the inside, and nothing needs to be learned.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Final, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidario.families.rplidar.spans import LIKENESS, alike, change_slowly, correct_leaps, extent, ignore_falls

__all__ = ["Arc", "Arcs", "FollowsRotation", "Rotation"]

Arc: TypeAlias = NDArray[np.int32] | NDArray[np.uint16] | NDArray[np.float64]

RETREAT_TURNS: Final = 1 / 36
"""How far packets under a check value fall back at most."""
STRANGE_SPANS: Final = 4
"""Spans in a row, all unlike what was ordinary so far, after which they are the ordinary ones."""
TRUSTED_GAP: Final = 8
"""Missing packets up to which the arc over the gap says more than an ordinary arc."""
CERTAIN_SPANS: Final = 6
"""Spans that must agree before the ordinary arc is certain; the fewest packets a revolution of any mode has."""
REMEMBERED_SPANS: Final = 64
"""Spans kept until then."""


class Arcs(NamedTuple):
    """What `Rotation.arcs` found, of each packet.

    Attributes:
        arc: Rotation during the packet, in heading units: whole numbers where nothing is missing. Where packets
            tell it themselves, only the part that they tell.
        missing: Packets missing behind it, an array; None when none is.
        typical: The arc of an ordinary packet, in heading units; 0 when nothing is known.
        certain: Whether enough arcs agree to be sure of that.
    """

    arc: Arc
    missing: NDArray[np.intp] | None
    typical: float
    certain: bool

    @property
    def lost(self) -> int:
        """Packets missing altogether."""
        return 0 if self.missing is None else int(self.missing.sum())

    @property
    def lost_behind(self) -> int:
        """Packets missing behind the last one."""
        return 0 if self.missing is None else int(self.missing[-1])

    @property
    def unbroken(self) -> int:
        """Leading packets before the first gap."""
        if self.missing is None or not self.missing.any():
            return len(self.arc)
        return int(np.flatnonzero(self.missing)[0]) + 1


class SteadyArcs(NamedTuple):
    """What `Rotation.steady` found in several revolutions without a gap.

    Attributes:
        arc: Rotation during each packet, in heading units.
        typical: The arc of an ordinary packet, of each revolution.
        last: That of the last packet.
    """

    arc: NDArray[np.int32]
    typical: list[float]
    last: float


class Rotation:
    """Follows the rotor through one stream.

    Args:
        full_turn: 360 degrees in the unit of the headings.
        jitter: Share of an ordinary arc by which headings may scatter before a packet counts as missing.
        retreat: Part of 360 degrees by which headings may fall back; any more is the long way round, forwards.
        inside: Part of its arc that a packet itself tells, where it does.
    """

    def __init__(
        self, full_turn: int, jitter: float = 0.5, retreat: float = RETREAT_TURNS, inside: float = 1.0
    ) -> None:
        self._full_turn = full_turn
        self._retreat = int(full_turn * retreat)
        self._jitter = jitter
        self._inside = inside
        self._typical = 0.0
        self._certain = False
        self._remembered = np.empty(0)
        self._strange = 0
        self._last_arc = 0.0

    def arcs(self, headings: NDArray[np.int32], following: int | None) -> Arcs:
        """The arc of each packet and the gaps behind them, given where the next packet begins, if known."""
        spans, shortest, longest, total = self._spans(headings, following)
        ordinary = self._jitter * self._typical < shortest and longest <= (1 + self._jitter) * self._typical
        if ordinary and self._certain and following is not None:
            # The mean is as good as the median where nothing is far from either, and much cheaper.
            self._typical = total / len(spans)
            self._strange = 0
            self._last_arc = float(spans[-1])
            return Arcs(spans, None, self._typical, certain=True)
        steady = self._certain and following is not None and shortest > 0 and self._last_arc > 0
        if steady and self._jitter <= 0.5 and change_slowly(self._last_arc, spans):
            # The next revolution goes on where this one ends.
            self._typical = self._last_arc = float(spans[-1])
            self._strange = 0
            return Arcs(spans, None, total / len(spans), certain=True)
        return self._among_gaps(self._signed(spans), following is not None)

    def steady(self, headings: NDArray[np.int32], following: int, ends: Sequence[int]) -> SteadyArcs | None:
        """The arcs of several revolutions, where `arcs` would find each of them ordinary; else None.

        Nothing is remembered before `settle`.

        Args:
            headings: Those of all packets.
            following: Where the packet behind them begins.
            ends: Packets up to the end of each revolution.
        """
        if not self._certain:
            return None
        spans, _, _, _ = self._spans(headings, following)
        begins = [0, *ends[:-1]]
        shortest = np.minimum.reduceat(spans, begins).tolist()
        longest = np.maximum.reduceat(spans, begins).tolist()
        totals = np.add.reduceat(spans, begins, dtype=np.int64).tolist()
        before, typical = self._typical, list[float]()
        for short, long, total, begin, end in zip(shortest, longest, totals, begins, ends, strict=True):
            if not (self._jitter * before < short and long <= (1 + self._jitter) * before):
                return None
            before = total / (end - begin)
            typical.append(before)
        return SteadyArcs(spans, typical, float(spans[-1]))

    def settle(self, arcs: SteadyArcs) -> None:
        """Remember revolutions that `steady` has told, as `arcs` would have."""
        self._typical = arcs.typical[-1]
        self._strange = 0
        self._last_arc = arcs.last

    def arcs_told(self, headings: NDArray[np.int32], following: int | None, told: NDArray[np.uint16]) -> Arcs:
        """As `arcs`, where the packets themselves tell how far the rotor turned inside of each.

        `Arcs.arc` then holds these values, not the whole arcs. Nothing is remembered.
        """
        _, farthest, total = extent(told)
        mean = total / len(told)
        steady = farthest <= (1 + LIKENESS) * mean
        # The mean is as good as the median where nothing is far from it, and much cheaper.
        typical = (mean if steady else float(np.median(told))) / self._inside
        raw, shortest, longest, _ = self._spans(headings, following)
        if following is not None and shortest > 0 and longest <= (1 + self._jitter) * typical:
            return Arcs(told, None, typical, certain=True)
        spans = self._signed(raw)
        if typical <= 0:
            return Arcs(told, None, 0.0, certain=False)
        # While the rotor changes its speed, each packet knows best how far it reaches.
        own = typical if steady else np.where(told > 0, told / self._inside, typical)
        missing = np.ceil(spans / own - 1 - self._jitter).astype(np.intp)
        if following is None:
            missing[-1] = 0
        ignore_falls(missing, spans)
        np.maximum(missing, 0, out=missing)
        if missing.any():
            return Arcs(told, missing, typical, certain=True)
        return Arcs(told, None, typical if steady else mean / self._inside, certain=True)

    def steady_told(
        self, headings: NDArray[np.int32], following: int, told: NDArray[np.uint16], ends: Sequence[int]
    ) -> list[float] | None:
        """The ordinary arc of several revolutions, where `arcs_told` would find no gap in any; else None.

        Nothing is remembered.
        """
        raw, shortest, _, _ = self._spans(headings, following)
        if shortest <= 0:
            return None
        begins = [0, *ends[:-1]]
        longest = np.maximum.reduceat(told, begins).tolist()
        totals = np.add.reduceat(told, begins, dtype=np.int64).tolist()
        farthest = np.maximum.reduceat(raw, begins).tolist()
        typical = list[float]()
        for begin, end, most, total, step in zip(begins, ends, longest, totals, farthest, strict=True):
            mean = total / (end - begin)
            if most > (1 + LIKENESS) * mean or step > (1 + self._jitter) * mean / self._inside:
                return None
            typical.append(mean / self._inside)
        return typical

    def _spans(self, headings: NDArray[np.int32], following: int | None) -> tuple[NDArray[np.int32], int, int, int]:
        """How far ahead of each heading the next one is, 0 where none follows; least, greatest and sum of that."""
        spans = np.empty_like(headings)
        np.subtract(headings[1:], headings[:-1], out=spans[:-1])
        last = 0 if following is None else following - int(headings[-1])
        # Mostly it is only here that the angles pass 0.
        spans[-1] = last + self._full_turn if last < -self._retreat else last
        least, greatest, total = extent(spans)
        if least < -self._retreat:
            np.add(spans, self._full_turn, out=spans, where=spans < -self._retreat)
            least, greatest, total = extent(spans)
        return spans, least, greatest, total

    def _signed(self, spans: NDArray[np.int32]) -> NDArray[np.float64]:
        """The same, where almost a full turn ahead is a little behind."""
        rough = spans.astype(np.float64)
        np.subtract(rough, self._full_turn, out=rough, where=rough >= self._full_turn - self._retreat)
        return rough

    def _among_gaps(self, spans: NDArray[np.float64], followed: bool) -> Arcs:
        """As `arcs`, where spans may hold more than one packet, or less."""
        typical = self._learn(spans if followed else spans[:-1])
        if typical <= 0:
            return Arcs(np.maximum(spans, 0.0), None, 0.0, certain=False)
        packets = spans / typical
        missing = np.ceil(packets - 1 - self._jitter).astype(np.intp)
        if not followed:
            missing[-1] = -1
        ignore_falls(missing, spans)
        correct_leaps(missing, spans, typical)
        arc = np.where(missing == 0, spans, typical)
        for gap in np.flatnonzero((missing > 0) & (missing <= TRUSTED_GAP)).tolist():
            arc[gap] = self._before_gap(arc, missing, gap, spans[gap] / (missing[gap] + 1))
        self._last_arc = float(arc[-1])
        return Arcs(arc, np.maximum(missing, 0), typical, self._certain)

    def _before_gap(self, arc: NDArray[np.float64], missing: NDArray[np.intp], gap: int, mean: float) -> float:
        """The arc of the packet before a gap: on the line from the packet before it to the middle of the gap."""
        before = float(arc[gap - 1]) if gap else self._last_arc
        if not before or (gap and missing[gap - 1]):
            return mean
        return before + (mean - before) / (1 + float(missing[gap]) / 2)

    def _learn(self, spans: NDArray[np.float64]) -> float:
        """The arc of an ordinary packet: the median of those that are near the last one known."""
        if not len(spans):
            return self._typical
        if not self._certain:
            return self._learn_first(spans)
        ordinary = spans
        if spans.max() > 1.5 * self._typical or spans.min() < self._typical / 2:
            ordinary = spans[np.abs(spans - self._typical) <= self._typical / 2]
        if len(ordinary):
            self._typical = self._middle(ordinary)
            self._strange = 0
        else:
            # A few strange spans are gaps; many, or some again and again, are another speed.
            self._strange += len(spans)
            if self._strange >= STRANGE_SPANS:
                self._certain, self._strange, self._remembered = False, 0, np.empty(0)
                return self._learn_first(spans)
        return self._typical

    def _middle(self, spans: NDArray[np.float64]) -> float:
        middle = len(spans) // 2
        median = float(np.partition(spans, middle)[middle])
        if self._jitter <= 0.5:
            return median
        # The arc of a node is a few units: one of 7.2 is 7 or 8, and the median 7.
        near = spans[np.abs(spans - median) <= median / 2]
        return float(near.mean()) if len(near) else median

    def _learn_first(self, spans: NDArray[np.float64]) -> float:
        """The same, as long as nothing is certain: from all spans seen so far."""
        seen = np.concatenate((self._remembered, spans))
        # Gaps only ever lengthen a span, so the short ones tell the truth.
        short = float(np.partition(seen, len(seen) // 4)[len(seen) // 4])
        if self._jitter <= 0.5:  # beyond it, ordinary arcs scatter so much that short ones say nothing
            for parts in (4, 3, 2):
                if np.count_nonzero(alike(seen, short / parts)) >= STRANGE_SPANS:
                    short /= parts
                    break
        ordinary = seen[np.abs(seen - short) <= short / 2]
        self._typical = self._middle(ordinary) if len(ordinary) else short
        agreeing = np.count_nonzero(alike(ordinary, self._typical)) if self._jitter <= 0.5 else len(ordinary)
        # Where most spans are gaps of any length, some agree by chance; but not most of the short ones.
        self._certain = bool(agreeing >= CERTAIN_SPANS and 2 * agreeing > len(ordinary))
        self._remembered = seen[-REMEMBERED_SPANS:]
        return self._typical


class FollowsRotation:
    """Base of the decoders: most of them remember nothing but a `Rotation` from one revolution to the next."""

    _rotation: Rotation

    def fork(self) -> Self:
        """As `Decoder.fork`."""
        twin = copy.copy(self)
        twin._rotation = copy.copy(self._rotation)  # noqa: SLF001 - its own
        return twin
