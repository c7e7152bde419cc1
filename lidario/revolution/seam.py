"""Where one revolution ends and the next begins, from the headings (start angles) of the packets alone.

The seam is the angle at which a revolution begins: 0, until a device marks a packet as its first and so states
its own. A revolution ends where the headings pass the seam, or at a marked packet, whichever comes; so a lost
mark cannot merge two revolutions. The rotor must have been seen on the far side of the seam first: readings that
tremble around it, or a mark just behind it, do not make a revolution.

A device may mark a packet as the first of a restarted stream. The documents read that mark in two ways: as a fault,
after which the angles before it mean nothing, or as an ordinary sign once in every revolution. The step from the
packet before decides: where it fits the steady step, also over a few missing packets, the stream simply goes on.

Only those headings matter that carry a flag or fall back behind the one before. In an undisturbed stream it is told
which these are (`FalsePackets.passing`).
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from statistics import median_high
from typing import NamedTuple

import numpy as np

from lidario.wire.formats import BEGINS, RESTARTS, Headings

_FLAGS = BEGINS | RESTARTS
_UNMARKED_REVOLUTIONS = 2
"""Revolutions without a mark after which none is waited for any more."""
_RECENT = 8
"""Headings from which the steady step is known."""
_WIDEST_GAP = 8
"""Steps, and at most 90 degrees, that a gap before the mark may have; wider ones would fit any angle by chance."""
_UNSTEADY = 0.3
"""Part of a step by which it may be off."""


class Split(NamedTuple):
    """A revolution begins at or inside a packet."""

    packet: int  # the packet, counted in the headings given
    marked: bool  # the device said so, and the packet is the first of the revolution
    broken: bool  # the stream began anew here: what came before is no revolution
    # The device marks its revolutions elsewhere than was known: what came before is only part of one.
    moved: bool = False
    seam: int = 0  # heading at which the revolution that begins here should begin; 0 while none is known


class Seam:
    """Follows the headings of one stream.

    Attributes:
        angle: The angle the revolution in progress began at, in heading units; None until it is known.
    """

    def __init__(self, full_turn: int, angle: int | None) -> None:
        self.angle = angle
        self._full_turn = full_turn
        self._near = full_turn // 4
        self._far = full_turn - full_turn // 12
        self._retreat = full_turn // 12
        self._last: int | None = None
        self._armed = False
        self._passed_unmarked = False
        self._unmarked_revolutions = 0
        self._recent: deque[Headings] = deque(maxlen=_RECENT)
        self._headings: Headings = ()

    def splits(self, headings: Headings, passing: Sequence[int] | None = None) -> list[Split]:
        """Where revolutions begin among `headings`.

        Args:
            headings: Those of the next packets.
            passing: As `FalsePackets.passing`; None where that is not known.
        """
        self._headings = headings
        found: list[Split] = []
        flagged: Sequence[int] = ()
        if len(headings) == 1:
            # As where a port is not polled: it need not be followed, as one with a flag.
            flagged = (0,)
        elif isinstance(headings, np.ndarray):
            flagged = (headings >= BEGINS).nonzero()[0].tolist()
        elif headings and max(headings) >= BEGINS:
            flagged = [at for at, heading in enumerate(headings) if heading >= BEGINS]
        if passing is not None and self.angle == 0 and not flagged:
            self._rise(headings, headings, 0, passing, found)
        else:
            begin = 0
            for at in flagged:
                if begin < at:
                    self._follow(headings[begin:at], begin, found)
                split = self._step(at, int(headings[at]))
                if split:
                    found.append(split)
                begin = at + 1
            if begin < len(headings):
                self._follow(headings[begin:], begin, found)
        self._recent.append(headings)
        return found

    def _follow(self, headings: Headings, offset: int, found: list[Split]) -> None:
        """Step along headings without flags, `offset` on from the first."""
        angle, full_turn = self.angle, self._full_turn
        if angle is None:
            found += [split for at, each in enumerate(headings, offset) if (split := self._step(at, int(each)))]
        elif isinstance(headings, np.ndarray):
            away = (headings - angle) % full_turn if angle else headings
            self._rise(headings, away, offset, ((away[1:] < away[:-1]).nonzero()[0] + 1).tolist(), found)
        else:
            few = [(heading - angle) % full_turn for heading in headings] if angle else headings
            # Sorting what is sorted is faster than any comparing by hand.
            rises = sorted(few) == few
            falls = () if rises else [at for at in range(1, len(few)) if few[at] < few[at - 1]]
            self._rise(headings, few, offset, falls, found)

    def _rise(
        self, headings: Headings, away: Headings, offset: int, falls: Sequence[int], found: list[Split]
    ) -> None:
        """As `_follow`, but step only onto those that fall back, behind which `away` from the seam all rise."""
        begin = 0
        for end in (*falls, len(away)):
            if begin < end:
                split = self._step(offset + begin, int(headings[begin]))
                if split:
                    found.append(split)
            if begin + 1 < end:
                self._last = int(away[end - 1])
                if self._last >= self._near:
                    self._passed_unmarked = False
                    if not self._armed:
                        beyond = max(begin + 1, bisect_left(away, self._near, begin, end))
                        self._armed = self._forward(int(away[beyond - 1]), int(away[beyond]))
            begin = end

    def _step(self, index: int, heading: int) -> Split | None:
        if heading >= BEGINS:
            return self._flagged(index, heading)
        if self.angle is None:
            self._await_mark(heading)
            return None
        away = (heading - self.angle) % self._full_turn
        last, self._last = self._last, away
        if last is None:
            self._armed = away >= self._near
            return None
        # Unarmed, only a fall from beyond the far side is doubtful: a reading that trembled back over the seam.
        if away < last - self._retreat and (self._armed or last <= self._far):
            self._armed = away >= self._near
            self._passed_unmarked = not self._armed
            return Split(index, marked=False, broken=False, seam=self.angle)
        if away >= self._near:
            self._passed_unmarked = False
            self._armed |= self._forward(last, away)
        return None

    def _await_mark(self, heading: int) -> None:
        """End the waiting for a mark after two revolutions without one: then 0 is as good as any angle."""
        if self._last is not None and heading < self._last - self._full_turn // 2:
            self._unmarked_revolutions += 1
        self._last = heading
        if self._unmarked_revolutions == _UNMARKED_REVOLUTIONS:
            self.angle, self._unmarked_revolutions = 0, 0

    def _forward(self, last: int, away: int) -> bool:
        """Whether a reading beyond the near quarter was reached forwards: not by trembling back over the seam."""
        return away <= self._far or (last < self._near and away - last < self._full_turn - self._retreat)

    def _goes_on(self, index: int, heading: int) -> bool:
        """Whether a heading follows the one before by the steady step, or by a few of them."""
        latest = [*(part[-_RECENT:] for part in self._recent), self._headings[max(0, index - _RECENT) : index]]
        before = [int(each) for part in latest for each in part][-_RECENT:]
        angles = [each & ~_FLAGS for each in before]
        steps = [(later - earlier) % self._full_turn for earlier, later in pairwise(angles)]
        steady = median_high(steps) if steps else 0
        if not steady:
            return False
        step = (heading - angles[-1]) % self._full_turn
        passed, most = step / steady, min(_WIDEST_GAP * steady, self._near) + _UNSTEADY * steady
        return step <= most and round(passed) > 0 and abs(passed - round(passed)) <= _UNSTEADY

    def _flagged(self, index: int, heading: int) -> Split | None:
        if heading & RESTARTS:
            if self.angle is not None and self._goes_on(index, heading & ~_FLAGS):
                return self._step(index, heading & ~_FLAGS)
            self._last = None
            self._step(index, heading & ~_FLAGS)
            return Split(index, marked=False, broken=True, seam=self.angle or 0)
        before, self.angle, self._unmarked_revolutions = self.angle, heading & ~_FLAGS, 0
        moved = before is not None and self._retreat < (self.angle - before) % self._full_turn <= self._far
        self._last = 0
        self._armed = False
        # A mark just behind the seam that the headings passed belongs to the revolution they began.
        belated, self._passed_unmarked = self._passed_unmarked, False
        if belated and not moved:
            return None
        return Split(index, marked=True, broken=False, moved=moved, seam=self.angle)
