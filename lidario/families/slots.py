"""What is missing where packets divide a revolution into equal slots, and each says which of them it is.

Such a device measures at angles and not at times: its packets cover the same angle at any speed. So nothing has to
be learned of the rotor. What the next packet is ahead of one slot was lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lidario.families.spans import Arcs, Heads, SteadyArcs, spans_between
from lidario.wire.events import Arrival

__all__ = ["SlotWheel"]


class SlotWheel:
    """Judges packets of equal slots; obeys `Turning`. It remembers nothing.

    Args:
        full_turn: 360 degrees in the unit of the headings.
        slots: How many packets a revolution has.
    """

    def __init__(self, full_turn: int, slots: int) -> None:
        self._full_turn = full_turn
        self._slots = slots
        self._slot = full_turn // slots

    def tell_time(self, sample_ns: float) -> None:
        """As `Turning.tell_time`: it is not needed."""

    def copy(self) -> Self:
        """As `Turning.copy`."""
        return self

    def follow(self, heads: Heads, arrivals: Sequence[Arrival] = ()) -> Arcs:  # noqa: ARG002
        """As `Turning.follow`."""
        spans, _, greatest, _ = spans_between(heads, self._full_turn, 0)
        count = len(spans)
        arcs = np.full(count, self._slot, np.int32)
        step = self._full_turn / (self._slots * heads.samples / count)
        if greatest <= self._slot:
            return Arcs(arcs, None, step, certain=True)
        missing = np.maximum(np.rint(spans / self._slot) - 1, 0) * heads.counts
        return Arcs(arcs, missing.astype(np.intp), step, certain=True)

    def steady(
        self,
        heads: Heads,  # noqa: ARG002
        ends: Sequence[int],  # noqa: ARG002
        arrivals: Sequence[Arrival] = (),  # noqa: ARG002
    ) -> SteadyArcs | None:
        """As `Turning.steady`: None, since what a sample takes differs from revolution to revolution."""
        return None

    def settle(self, arcs: SteadyArcs, arrivals: Sequence[Arrival] = ()) -> None:
        """As `Turning.settle`: nothing is remembered."""
