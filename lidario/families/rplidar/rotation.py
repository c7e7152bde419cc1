"""What is missing among packets that tell themselves how far the rotor turned: those that hold whole nodes.

A packet of 0x83 holds the angles of 96 nodes, so the arc of each packet is known from the inside. A packet of 0x81
is one node: its arc is the step from one sample to the next. The angles of nodes are corrected, so that steps
scatter by most of one; only in the mean they are even. Packets that only state where they begin are for `Wheel`.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from lidario.families.rplidar.spans import correct_leaps, ignore_falls
from lidario.families.spans import LIKENESS, RETREAT_TURNS, Arcs, SteadyArcs, extent, spans_between

__all__ = ["NodeSteps", "ToldArcs"]

NODE_RETREAT_TURNS: Final = 1 / 12
"""How far nodes do: without a check value, a few bytes may pass for nodes that are up to 30 degrees ahead."""
JITTER: Final = 0.5
NODE_JITTER: Final = 0.75
"""Share of an ordinary arc by which headings may scatter before a packet counts as missing. Of nodes, only a
doubled step is a lost one."""
STRANGE_STEPS: Final = 4
"""Steps in a row, all unlike what was ordinary so far, after which they are the ordinary ones."""
CERTAIN_STEPS: Final = 6
REMEMBERED_STEPS: Final = 64
"""Steps that must agree before the ordinary one is certain, and how many are kept until then."""


class NodeSteps:
    """Follows the nodes of one stream.

    Args:
        full_turn: 360 degrees in the unit of the headings.
    """

    def __init__(self, full_turn: int) -> None:
        self._full_turn = full_turn
        self._retreat = int(full_turn * NODE_RETREAT_TURNS)
        self._typical = 0.0
        self._certain = False
        self._remembered = np.empty(0)
        self._strange = 0

    def fork(self) -> Self:
        """As `Decoder.fork`."""
        return copy.copy(self)

    def arcs(self, headings: NDArray[np.int32], following: int | None) -> Arcs:
        """The steps and the gaps behind them, given where the next packet begins, if known."""
        spans, shortest, longest, total = spans_between(headings, following, self._full_turn, self._retreat)
        if self._certain and following is not None and self._is_ordinary(self._typical, shortest, longest):
            # The mean is as good as the median where nothing is far from either, and much cheaper.
            self._typical, self._strange = total / len(spans), 0
            return Arcs(spans, None, self._typical, certain=True)
        rough = spans.astype(np.float64)
        typical = self._learn(rough if following is not None else rough[:-1])
        if typical <= 0:
            return Arcs(np.maximum(rough, 0.0), None, 0.0, certain=False)
        missing = np.ceil(rough / typical - 1 - NODE_JITTER).astype(np.intp)
        if following is None:
            missing[-1] = -1
        ignore_falls(missing, rough)
        correct_leaps(missing, rough, typical)
        return Arcs(rough, np.maximum(missing, 0), typical, self._certain)

    def steady(self, headings: NDArray[np.int32], following: int, ends: Sequence[int]) -> SteadyArcs | None:
        """The steps of several revolutions, where `arcs` would find each of them ordinary; else None.

        Nothing is remembered before `settle`.

        Args:
            headings: Those of all packets.
            following: Where the packet behind them begins.
            ends: Packets up to the end of each revolution.
        """
        if not self._certain:
            return None
        spans, _, _, _ = spans_between(headings, following, self._full_turn, self._retreat)
        begins = [0, *ends[:-1]]
        shortest = np.minimum.reduceat(spans, begins).tolist()
        longest = np.maximum.reduceat(spans, begins).tolist()
        totals = np.add.reduceat(spans, begins, dtype=np.int64).tolist()
        before, typical = self._typical, list[float]()
        for short, long, total, begin, end in zip(shortest, longest, totals, begins, ends, strict=True):
            if not self._is_ordinary(before, short, long):
                return None
            before = total / (end - begin)
            typical.append(before)
        return SteadyArcs(spans, typical, float(spans[-1]))

    def settle(self, arcs: SteadyArcs) -> None:
        """Remember revolutions that `steady` has told, as `arcs` would have."""
        self._typical, self._strange = arcs.typical[-1], 0

    @staticmethod
    def _is_ordinary(typical: float, shortest: int, longest: int) -> bool:
        return NODE_JITTER * typical < shortest and longest <= (1 + NODE_JITTER) * typical

    def _learn(self, spans: NDArray[np.float64]) -> float:
        """The ordinary step: the mean of those that are near the last one known."""
        if not len(spans):
            return self._typical
        if not self._certain:
            return self._learn_first(spans)
        ordinary = spans
        if spans.max() > 1.5 * self._typical or spans.min() < self._typical / 2:
            ordinary = spans[np.abs(spans - self._typical) <= self._typical / 2]
        if len(ordinary):
            self._typical, self._strange = _middle(ordinary), 0
        else:
            # A few strange steps are gaps; many, or some again and again, are another speed.
            self._strange += len(spans)
            if self._strange >= STRANGE_STEPS:
                self._certain, self._strange, self._remembered = False, 0, np.empty(0)
                return self._learn_first(spans)
        return self._typical

    def _learn_first(self, spans: NDArray[np.float64]) -> float:
        """The same, as long as nothing is certain: from all steps seen so far."""
        seen = np.concatenate((self._remembered, spans))
        # Gaps only ever lengthen a step, so the short ones tell the truth.
        short = float(np.partition(seen, len(seen) // 4)[len(seen) // 4])
        ordinary = seen[np.abs(seen - short) <= short / 2]
        self._typical = _middle(ordinary) if len(ordinary) else short
        self._certain = len(ordinary) >= CERTAIN_STEPS
        self._remembered = seen[-REMEMBERED_STEPS:]
        return self._typical


def _middle(spans: NDArray[np.float64]) -> float:
    middle = len(spans) // 2
    median = float(np.partition(spans, middle)[middle])
    # A step is a few units: one of 7.2 is 7 or 8, and the median 7.
    near = spans[np.abs(spans - median) <= median / 2]
    return float(near.mean()) if len(near) else median


class ToldArcs:
    """Judges packets of which each tells how far the rotor turned inside of it. It remembers nothing.

    Args:
        full_turn: 360 degrees in the unit of the headings.
        inside: Part of its arc that a packet itself tells.
    """

    def __init__(self, full_turn: int, inside: float) -> None:
        self._full_turn = full_turn
        self._retreat = int(full_turn * RETREAT_TURNS)
        self._inside = inside

    def arcs(self, headings: NDArray[np.int32], following: int | None, told: NDArray[np.uint16]) -> Arcs:
        """The gaps behind packets; `Arcs.arc` holds what is told, not the whole arcs."""
        _, farthest, total = extent(told)
        mean = total / len(told)
        steady = farthest <= (1 + LIKENESS) * mean
        # The mean is as good as the median where nothing is far from it, and much cheaper.
        typical = (mean if steady else float(np.median(told))) / self._inside
        spans, shortest, longest, _ = spans_between(headings, following, self._full_turn, self._retreat)
        if following is not None and shortest > 0 and longest <= (1 + JITTER) * typical:
            return Arcs(told, None, typical, certain=True)
        if typical <= 0:
            return Arcs(told, None, 0.0, certain=False)
        # While the rotor changes its speed, each packet knows best how far it reaches.
        own = typical if steady else np.where(told > 0, told / self._inside, typical)
        missing = np.ceil(spans / own - 1 - JITTER).astype(np.intp)
        if following is None:
            missing[-1] = 0
        ignore_falls(missing, spans)
        np.maximum(missing, 0, out=missing)
        if missing.any():
            return Arcs(told, missing, typical, certain=True)
        return Arcs(told, None, typical if steady else mean / self._inside, certain=True)

    def steady(
        self, headings: NDArray[np.int32], following: int, told: NDArray[np.uint16], ends: Sequence[int]
    ) -> list[float] | None:
        """The ordinary arc of several revolutions, where `arcs` would find no gap in any; else None."""
        spans, shortest, _, _ = spans_between(headings, following, self._full_turn, self._retreat)
        if shortest <= 0:
            return None
        begins = [0, *ends[:-1]]
        longest = np.maximum.reduceat(told, begins).tolist()
        totals = np.add.reduceat(told, begins, dtype=np.int64).tolist()
        farthest = np.maximum.reduceat(spans, begins).tolist()
        typical = list[float]()
        for begin, end, most, total, step in zip(begins, ends, longest, totals, farthest, strict=True):
            mean = total / (end - begin)
            if most > (1 + LIKENESS) * mean or step > (1 + JITTER) * mean / self._inside:
                return None
            typical.append(mean / self._inside)
        return typical
