"""What is missing among the nodes of 0x81, each of which is a packet of its own.

The step from one node to the next is a few units of the angle, and angles are corrected: steps scatter by most of
one, and are even only in the mean. A node has two check bits, so that a few bytes may pass for one whose angle is
somewhere else.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from lidario.families.spans import Arcs, Heads, SteadyArcs, by_revolution, spans_between
from lidario.wire.events import Arrival

__all__ = ["NodeSteps"]

Steps = NDArray[np.float64]

RETREAT_TURNS: Final = 1 / 12
"""How far nodes fall back at most: without a check value, a few bytes may pass for nodes up to 30 degrees ahead."""
JITTER: Final = 0.75
"""Share of an ordinary step by which steps may scatter: only a doubled one is a lost node."""
STRANGE_STEPS: Final = 4
"""Steps in a row, all unlike what was ordinary so far, after which they are the ordinary ones."""
CERTAIN_STEPS: Final = 6
REMEMBERED_STEPS: Final = 64
"""Steps that must agree before the ordinary one is certain, and how many are kept until then."""
FALSE_NODES: Final = 40
"""Nodes within which a leap and a fall belong together: between them stands what was no node."""


class NodeSteps:
    """Follows the nodes of one stream; obeys `Turning`.

    Args:
        full_turn: 360 degrees in the unit of the headings.
    """

    def __init__(self, full_turn: int) -> None:
        self._full_turn = full_turn
        self._retreat = int(full_turn * RETREAT_TURNS)
        self._typical = 0.0
        self._certain = False
        self._remembered = np.empty(0)
        self._strange = 0

    def tell_time(self, sample_ns: float) -> None:
        """As `Turning.tell_time`: the steps tell how far the rotor turned."""

    def copy(self) -> Self:
        """As `Turning.copy`."""
        return copy.copy(self)

    def follow(self, heads: Heads, arrivals: Sequence[Arrival] = ()) -> Arcs:  # noqa: ARG002
        """As `Turning.follow`."""
        followed = heads.following is not None
        spans, shortest, longest, total = spans_between(heads, self._full_turn, self._retreat)
        if self._certain and followed and self._is_ordinary(self._typical, shortest, longest):
            # The mean is as good as the median where nothing is far from either, and much cheaper.
            self._typical, self._strange = total / len(spans), 0
            return Arcs(spans, None, self._typical, certain=True)
        rough = spans.astype(np.float64)
        typical = self._learn(rough if followed else rough[:-1])
        if typical <= 0:
            return Arcs(np.maximum(rough, 0.0), None, 0.0, certain=False)
        missing = _missing(rough, typical)
        if not followed:
            missing[-1] = 0
        return Arcs(rough, missing if missing.any() else None, typical, self._certain)

    def steady(self, heads: Heads, ends: Sequence[int]) -> SteadyArcs | None:
        """As `Turning.steady`."""
        if not self._certain:
            return None
        spans, _, _, _ = spans_between(heads, self._full_turn, self._retreat)
        typical, begin, steps = self._typical, 0, list[float]()
        for end, (shortest, longest, total) in zip(ends, by_revolution(spans, ends), strict=True):
            if not self._is_ordinary(typical, shortest, longest):
                return None
            typical, begin = total / (end - begin), end
            steps.append(typical)
        return SteadyArcs(spans, steps)

    def settle(self, arcs: SteadyArcs) -> None:
        """As `Turning.settle`."""
        self._typical, self._strange = arcs.steps[-1], 0

    @staticmethod
    def _is_ordinary(typical: float, shortest: int, longest: int) -> bool:
        return JITTER * typical < shortest and longest <= (1 + JITTER) * typical

    def _learn(self, spans: Steps) -> float:
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

    def _learn_first(self, spans: Steps) -> float:
        """The same, as long as nothing is certain: from all steps seen so far."""
        seen = np.concatenate((self._remembered, spans))
        # Gaps only ever lengthen a step, so the short ones tell the truth.
        short = float(np.partition(seen, len(seen) // 4)[len(seen) // 4])
        ordinary = seen[np.abs(seen - short) <= short / 2]
        self._typical = _middle(ordinary) if len(ordinary) else short
        self._certain = len(ordinary) >= CERTAIN_STEPS
        self._remembered = seen[-REMEMBERED_STEPS:]
        return self._typical


def _middle(spans: Steps) -> float:
    middle = len(spans) // 2
    median = float(np.partition(spans, middle)[middle])
    # A step is a few units: one of 7.2 is 7 or 8, and the median 7.
    near = spans[np.abs(spans - median) <= median / 2]
    return float(near.mean()) if len(near) else median


def _missing(spans: Steps, typical: float) -> NDArray[np.intp]:
    """Nodes missing behind each."""
    missing = np.ceil(spans / typical - 1 - JITTER).astype(np.intp)
    # A leap beside a fall is one heading that is out of place, not a gap.
    falls = spans < 0
    missing[1:][falls[:-1]] = -1
    missing[:-1][falls[1:]] = -1
    # Where headings leap ahead and soon fall back, only the difference is missing.
    for fall in np.flatnonzero(spans < -2 * typical).tolist():
        leaps = np.flatnonzero(missing[max(0, fall - FALSE_NODES) : fall] > 0)
        if len(leaps):
            leap = max(0, fall - FALSE_NODES) + int(leaps[-1])
            missing[leap] = max(0, int(missing[leap]) + round(float(spans[fall]) / typical))
    return np.maximum(missing, 0)
