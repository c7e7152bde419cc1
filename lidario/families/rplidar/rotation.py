"""How far the rotor turned during each packet, and how many packets are missing.

A packet states where it begins but not where it ends: that is where the next one begins. Dividing the arc
between two packets by the samples of one is right only when the second really followed the first. After a loss
the vendor's SDK stretches the samples over the whole gap. Here the arc of an ordinary packet is known from the
neighbours, so the number of missing packets is too, and each packet gets its own share of the arc.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Arcs", "Rotation"]

RETREAT_TURNS: Final = 1 / 36
"""Headings may fall back by up to this part of 360 degrees; any more is the long way round, forwards."""
STRANGE_SPANS: Final = 4
"""Spans in a row, all unlike what was ordinary so far, after which they are the ordinary ones."""
TRUSTED_GAP: Final = 8
"""Missing packets up to which the arc over the gap says more than an ordinary arc."""


class Arcs(NamedTuple):
    """What `Rotation.arcs` found, of each packet.

    Attributes:
        arc: Rotation during the packet, in heading units: whole numbers where nothing is missing.
        missing: Packets missing behind it, an array; None when none is.
    """

    arc: NDArray[np.int32] | NDArray[np.float64]
    missing: NDArray[np.intp] | None

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


class Rotation:
    """Follows the rotor through one stream.

    Args:
        full_turn: 360 degrees in the unit of the headings.
        jitter: Share of an ordinary arc by which headings may scatter before a packet counts as missing.
    """

    def __init__(self, full_turn: int, jitter: float = 0.5) -> None:
        self._full_turn = full_turn
        self._retreat = int(full_turn * RETREAT_TURNS)
        self._jitter = jitter
        self._typical = 0.0
        self._strange = 0
        self._last_arc = 0.0

    def arcs(self, headings: NDArray[np.int32], following: int | None) -> Arcs:
        """The arc of each packet and the gaps behind them, given where the next packet begins, if known."""
        spans = np.empty_like(headings)
        np.subtract(headings[1:], headings[:-1], out=spans[:-1])
        spans[-1] = 0 if following is None else following - int(headings[-1])
        np.add(spans, self._full_turn, out=spans, where=spans < -self._retreat)
        shortest, longest, total = int(spans.min()), int(spans.max()), int(spans.sum())
        ordinary = self._jitter * self._typical < shortest and longest <= (1 + self._jitter) * self._typical
        if ordinary and following is not None:
            # The mean is as good as the median where nothing is far from either, and much cheaper.
            self._typical = total / len(spans)
            self._strange = 0
            self._last_arc = float(spans[-1])
            return Arcs(spans, None)
        rough = spans.astype(np.float64)
        np.subtract(rough, self._full_turn, out=rough, where=rough >= self._full_turn - self._retreat)
        return self._among_gaps(rough, following is not None)

    def _among_gaps(self, spans: NDArray[np.float64], followed: bool) -> Arcs:
        """As `arcs`, where spans may hold more than one packet, or less."""
        typical = self._learn(spans if followed else spans[:-1])
        if typical <= 0:
            return Arcs(np.maximum(spans, 0.0), None)
        packets = spans / typical
        missing = np.ceil(packets - 1 - self._jitter).astype(np.intp)
        if not followed:
            missing[-1] = -1
        # A leap beside a fall is one heading that is out of place, not a gap.
        falls = spans < 0
        missing[1:][falls[:-1]] = -1
        missing[:-1][falls[1:]] = -1
        arc = np.where(missing == 0, spans, typical)
        for gap in np.flatnonzero((missing > 0) & (missing <= TRUSTED_GAP)).tolist():
            arc[gap] = self._before_gap(arc, missing, gap, spans[gap] / (missing[gap] + 1))
        self._last_arc = float(arc[-1])
        return Arcs(arc, np.maximum(missing, 0))

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
        # Gaps only ever lengthen a span, so when nothing is known the short ones tell the truth.
        short = float(np.partition(spans, len(spans) // 4)[len(spans) // 4])
        near = self._typical or short
        ordinary = spans
        if spans.max() > 1.5 * near or spans.min() < near / 2:
            ordinary = spans[np.abs(spans - near) <= near / 2]
        if len(ordinary):
            middle = len(ordinary) // 2
            self._typical = float(np.partition(ordinary, middle)[middle])
            self._strange = 0
        else:
            # A few strange spans are gaps; many, or some again and again, are another speed.
            self._strange += len(spans)
            if self._strange >= STRANGE_SPANS:
                self._typical = short
        return self._typical
