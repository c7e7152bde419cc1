"""How far the rotor turned from sample to sample, and what is missing, where packets tell their own part of that.

Such a packet states the angles of its first and of its last sample; its *way* lies between, and its samples lie at
equal *steps* on it. From its last sample to the first one of the next packet the rotor turns by one step more. What
that *jump* holds beyond was lost.

1. **Each packet has its own step.** The rotor may turn evenly, speed up, stop or creep: the jump behind a packet is
   held against the longer of the two steps beside it.
2. **A step that is like none beside it is damage** that a weak check value let pass; then that of its neighbours is
   taken. So is a way that no step explains, if the jump beside it would be as odd. The others tell the truth; what
   such a packet itself says of its samples is not changed, for that must not depend on others.
3. **What passed unseen passed as beside it**, but where the rotor all but stood: then as fast as it turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.spans import LIKENESS, RETREAT_TURNS, Arcs, Heads, Ints, Turning
from lidario.wire.events import Arrival

Floats = NDArray[np.float64]

_CHANGING: Final = 1.1
"""If the longest way of a revolution exceeds that of its mean step by this factor, its speed may change."""
FEWEST: Final = 6
"""Packets from which the longest one is an ordinary one, where they are of any size: of a revolution, the first one
and the last one may be short."""
_FEWEST_STEPS: Final = 6
"""Steps in a packet from which their mean is known well enough."""
_BACKWARD: Final = RETREAT_TURNS / 5
"""By so much, 2 degrees, a packet may begin before the end of the one before, with nothing missing."""


@dataclass(frozen=True, slots=True)
class ToldWheel(Turning):
    """Judges packets that tell their own way. It remembers nothing."""

    full_turn: int  # 360 degrees in the unit of the headings
    least: float  # samples that are missing at least where anything is

    def follow(self, heads: Heads, arrivals: Sequence[Arrival] = ()) -> Arcs:  # noqa: ARG002
        if heads.following is not None and (arcs := self.follow_several(heads, (len(heads.first),))) is not None:
            return arcs
        first, way, counts = heads.first, np.asarray(heads.way), heads.counts
        inner = heads.samples - len(first)
        turned = int(np.add.reduce(way)) if inner else 0
        if not turned:
            return Arcs(way, None, 0.0, certain=False)
        step = _steps_of(way, counts)
        tails = first + way
        jumps = self._jumps(first, tails, heads.following)
        gaps = jumps > self._one(step)
        if gaps.any():
            usual: Floats = np.multiply(np.subtract(counts, 1), step, dtype=np.float64)
            first, tails = self._mended(heads, tails, jumps, usual, step)
            jumps = self._jumps(first, tails, heads.following)
            turned = int(np.add.reduce(tails - first))
            gaps = jumps > self._one(step)
        mean = turned / inner
        if not gaps.any():
            if heads.following is not None:
                # With the jumps, all of which are known, it is more exact.
                mean = (turned + int(np.add.reduce(jumps))) / heads.samples
            return Arcs(way, None, mean, certain=True)
        # Beside where it all but stood, it may have turned as fast as it does.
        fastest = float(step.max())
        step = np.where(step < LIKENESS * fastest, fastest, step)
        skipped = np.where(gaps, np.rint(jumps / step) - 1, 0).astype(np.intp)
        return Arcs(way, skipped, mean, certain=True)

    def follow_several(
        self,
        heads: Heads,
        ends: Sequence[int],
        arrivals: Sequence[Arrival] = (),  # noqa: ARG002
    ) -> Arcs | None:
        way, counts, begins = np.asarray(heads.way), heads.counts, [0, *ends[:-1]]
        tails = heads.first + way
        jumps = self._jumps(heads.first, tails, heads.following)
        turned = np.add.reduceat(way, begins, dtype=np.int64).tolist()
        between = np.add.reduceat(jumps, begins, dtype=np.int64).tolist()
        longest = np.maximum.reduceat(way, begins).tolist()
        farthest = np.maximum.reduceat(jumps, begins).tolist()
        packets = [end - begin for begin, end in zip(begins, ends, strict=True)]
        if isinstance(counts, int):
            samples, most = [each * counts for each in packets], [counts] * len(ends)
        else:
            samples = np.add.reduceat(counts, begins).tolist()
            most = np.maximum.reduceat(counts, begins).tolist()
        steps = list[float]()
        for at, way_turned in enumerate(turned):
            inner = samples[at] - packets[at]
            if not (inner and way_turned) or (packets[at] < FEWEST and not isinstance(counts, int)):
                return None
            mean = way_turned / inner
            if longest[at] > _CHANGING * mean * (most[at] - 1) or farthest[at] > (1 + self.least) * mean:
                return None
            steps.append((way_turned + between[at]) / samples[at])
        return Arcs(way, None, steps[-1], certain=True, steps=steps)

    def _one(self, step: Floats) -> Floats:
        """Up to where a jump is one step. The angles at both its ends are rounded."""
        return (1 + self.least) * step + 1

    def _jumps(self, first: Ints, tails: Ints, following: int | None) -> Ints:
        """How far ahead of the end of each packet the next one begins; 0 where it begins a little before that.

        Packets begin at `first` and end at `tails`, counted on past 360 degrees; where what is `following` is not
        known, the last jump is 0.
        """
        jumps = np.empty(len(first), first.dtype)
        np.subtract(first[1:], tails[:-1], out=jumps[:-1])
        jumps[-1] = 0 if following is None else following - int(tails[-1])
        jumps %= self.full_turn
        jumps[jumps > self.full_turn - int(self.full_turn * _BACKWARD)] = 0
        return jumps

    def _mended(self, heads: Heads, tails: Ints, jumps: Ints, usual: Floats, step: Floats) -> tuple[Ints, Ints]:
        """Angles of first and last samples; one that is damaged is computed from the other one of its packet.

        An angle is taken as damaged if the jump beside it disappears when it is computed, or if it is farther from
        the other one than any speed explains. `tails` and `jumps` are as in `_jumps`, `usual` are the ways that
        each `step` to the next sample tells.
        """
        first, following = heads.first, heads.following
        ways, one = np.rint(usual).astype(np.int32), self._one(step)
        ahead = jumps > one
        # The first angle is damaged if the packet before ends right before it, once it is computed,
        from_last = (tails - ways) % self.full_turn
        near = self._jumps(from_last, tails, following) <= one
        wrong_first = np.append(False, ahead[:-1] & near[:-1])
        # and the last one if no way is as long, or if the next packet then begins right behind it.
        near = self._jumps(first, first + ways, following) <= one
        wrong_last = ~wrong_first & ahead & ((tails - first > 2 * usual + step) | near)
        begins = np.where(wrong_first, from_last, first)
        return begins, np.where(wrong_first, from_last + ways, np.where(wrong_last, first + ways, tails))


def _steps_of(way: Ints, counts: Ints | int) -> Floats:
    """How far the rotor turns from the last sample of each packet to the next one, if nothing is missing."""
    inner = np.broadcast_to(np.subtract(counts, 1), way.shape)
    long = (inner >= min(_FEWEST_STEPS, int(inner.max()))).nonzero()[0]
    # It may turn by less than the headings resolve.
    own: Floats = np.maximum(way[long], 1) / inner[long]
    if len(own) > 1:
        # One that is like none beside it is damaged.
        before, after = np.append(own[1], own[:-1]), np.append(own[1:], own[-2])
        own = np.maximum(np.minimum(before, after), np.minimum(own, np.maximum(before, after)))
        own[:-1] = np.maximum(own[:-1], own[1:])
    # A short packet has that of the long one before.
    return own[np.maximum(np.searchsorted(long, np.arange(len(way)), "right") - 1, 0)]
