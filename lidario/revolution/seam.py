"""Finds where one revolution ends and the next begins, from the headings (start angles) of the packets alone.

The seam is the angle at which a revolution begins: 0, until a device marks a packet as the first of a revolution
and so states its own. A revolution ends where the headings pass the seam or at a marked packet, whichever comes
first, so a lost mark cannot merge two revolutions. The rotor must have been seen away from the seam before:
headings that tremble around it, or a mark just behind it, do not make a revolution.

A device may mark a packet as the first of a restarted stream. Documents give that mark two meanings: a fault, after
which the angles before it mean nothing, or an ordinary sign once in every revolution. The step from the packet
before decides: if it fits the steady step, also over a few missing packets, the stream simply goes on.

Only headings that carry a flag, or fall back behind the heading before, can end a revolution. In an undisturbed
stream `FalsePackets.passing` says which headings fall back.
"""

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
"""After this many revolutions without a mark, no mark is awaited any more."""
_RECENT = 8
"""How many headings before a mark give the steady step."""
_WIDEST_GAP = 8
"""A gap before the mark may have this many steps, and at most 90 degrees: a wider one fits any angle by chance."""
_UNSTEADY = 0.3
"""Part of a step by which the step before a mark may be off."""


class Split(NamedTuple):
    """A revolution begins at or inside a packet."""

    packet: int  # number of the packet among the headings given
    marked: bool  # the device marked this packet as the first of the revolution
    broken: bool  # the stream began anew here: the packets before are no revolution
    seam: int  # heading at which the revolution that begins here should begin; 0 while no seam is known
    # The device marks its revolutions elsewhere than was known: the packets before are only part of one.
    moved: bool = False


class Seam:
    """Follows the headings of one stream.

    Attributes:
        angle: The heading of the seam; None until it is known.
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
            headings: The headings of the next packets.
            passing: Numbers of those that passed 0, as from `FalsePackets.passing`; None if unknown.
        """
        self._headings = headings
        found: list[Split] = []
        flagged: Sequence[int] = ()
        if len(headings) == 1:
            # The usual case of a port that is not polled. One heading is stepped onto at once, as one with a flag.
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
        """Step along headings without flags, of which the first has number `offset`."""
        angle, full_turn = self.angle, self._full_turn
        if angle is None:
            found += [split for at, each in enumerate(headings, offset) if (split := self._step(at, int(each)))]
        elif isinstance(headings, np.ndarray):
            away = (headings - angle) % full_turn if angle else headings
            self._rise(headings, away, offset, ((away[1:] < away[:-1]).nonzero()[0] + 1).tolist(), found)
        else:
            few = [(heading - angle) % full_turn for heading in headings] if angle else headings
            # Sorting a sorted list is faster than a loop of comparisons.
            rises = sorted(few) == few
            falls = () if rises else [at for at in range(1, len(few)) if few[at] < few[at - 1]]
            self._rise(headings, few, offset, falls, found)

    def _rise(
        self, headings: Headings, away: Headings, offset: int, falls: Sequence[int], found: list[Split]
    ) -> None:
        """As `_follow`, but step only onto the `falls`; between them `away`, the angles behind the seam, rises."""
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
        # Unarmed, within the first quarter, a fall from beyond `_far` is no new revolution: the heading before had
        # only trembled back over the seam.
        if away < last - self._retreat and (self._armed or last <= self._far):
            self._armed = away >= self._near
            self._passed_unmarked = not self._armed
            return Split(index, marked=False, broken=False, seam=self.angle)
        if away >= self._near:
            self._passed_unmarked = False
            self._armed = self._armed or self._forward(last, away)
        return None

    def _await_mark(self, heading: int) -> None:
        """Stop waiting for a mark after two revolutions without one: then 0 is as good a seam as any angle."""
        if self._last is not None and heading < self._last - self._full_turn // 2:
            self._unmarked_revolutions += 1
        self._last = heading
        if self._unmarked_revolutions == _UNMARKED_REVOLUTIONS:
            self.angle, self._unmarked_revolutions = 0, 0

    def _forward(self, last: int, away: int) -> bool:
        """Whether a heading beyond the first quarter was reached forwards, not by trembling back over the seam."""
        return away <= self._far or (last < self._near and away - last < self._full_turn - self._retreat)

    def _goes_on(self, index: int, heading: int) -> bool:
        """Whether a heading follows the one before by the steady step, or by a few steps."""
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
        # A mark just behind the seam belongs to the revolution that began when the headings passed the seam.
        belated, self._passed_unmarked = self._passed_unmarked, False
        if belated and not moved:
            return None
        return Split(index, marked=True, broken=False, moved=moved, seam=self.angle)
