"""Finds how far the rotor turned, and what is missing, for packets that tell their own rotation.

Such a packet states the angles of its first and of its last sample. The rotation between them is its *way*, and its
samples lie on it at equal *steps*. From its last sample to the first one of the next packet, the rotor turns by one
step more. If this *jump* is longer than a step, samples were lost.

1. **Each packet has its own step.** The rotor may turn evenly, speed up, stop or creep. The jump behind a packet is
   compared with the longer of the two steps beside it.
2. **A step that is like none beside it is damage** that a weak check value let pass. Then the step of its
   neighbours is used. The same holds for a way that no step explains, if the jump beside it would be as odd. The
   neighbours are right. The angles of the damaged packet's own samples are not changed, for they must not depend on
   other packets.
3. **In a gap the rotor turned as fast as beside it.** If it all but stood there, it turned at its fastest.
"""

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
"""If packets have any size, the longest of at least this many is an ordinary one. The first and the last one of a
revolution may be short."""
_FEWEST_STEPS: Final = 6
"""A packet with at least this many steps gives their mean well enough."""
_BACKWARD: Final = RETREAT_TURNS / 5
"""A packet may begin this much, 2 degrees, before the end of the one before, with nothing missing."""


@dataclass(frozen=True, slots=True)
class ToldWheel(Turning):
    """Follows the rotor by packets that tell their own way. It remembers nothing."""

    full_turn: int  # 360 degrees in the unit of the headings
    least: float  # least number of samples that a gap lacks

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
            if not turned:
                # All that told a way was damaged.
                return Arcs(way, None, 0.0, certain=False)
            gaps = jumps > self._one(step)
        mean = turned / inner
        if not gaps.any():
            if heads.following is not None:
                # All jumps are known: with them, the mean is more exact.
                mean = (turned + int(np.add.reduce(jumps))) / heads.samples
            return Arcs(way, None, mean, certain=True)
        # Beside a packet in which the rotor all but stood, it may have turned at its fastest.
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
        """The longest jump that is still one step. One unit more, because the angles at both ends are rounded."""
        return (1 + self.least) * step + 1

    def _jumps(self, first: Ints, tails: Ints, following: int | None) -> Ints:
        """How far ahead of the end of each packet the next one begins; 0 if it begins a little before that end.

        Packets begin at `first` and end at `tails`, counted on past 360 degrees. If `following` is None, the last
        jump is 0.
        """
        jumps = np.empty(len(first), first.dtype)
        np.subtract(first[1:], tails[:-1], out=jumps[:-1])
        jumps[-1] = 0 if following is None else following - int(tails[-1])
        jumps %= self.full_turn
        jumps[jumps > self.full_turn - int(self.full_turn * _BACKWARD)] = 0
        return jumps

    def _mended(self, heads: Heads, tails: Ints, jumps: Ints, usual: Floats, step: Floats) -> tuple[Ints, Ints]:
        """The angles of first and last samples; a damaged one is computed from the other angle of its packet.

        The first angle is damaged if the jump before it disappears when it is computed. The last angle is damaged
        if there is a jump behind it that disappears so, or a way that is longer than any speed explains. `tails`
        and `jumps` are as in `_jumps`; `usual` are the ways that follow from each `step`.
        """
        first, following = heads.first, heads.following
        ways, one = np.rint(usual).astype(np.int32), self._one(step)
        ahead = jumps > one
        # The first angle is damaged if, once it is computed, the packet before ends right before it.
        from_last = (tails - ways) % self.full_turn
        near = self._jumps(from_last, tails, following) <= one
        wrong_first = np.append(False, ahead[:-1] & near[:-1])
        # The last angle is damaged if there is a jump behind it, and the way is longer than any can be or, once the
        # angle is computed, the next packet begins right behind it.
        near = self._jumps(first, first + ways, following) <= one
        wrong_last = ~wrong_first & ahead & ((tails - first > 2 * usual + step) | near)
        begins = np.where(wrong_first, from_last, first)
        return begins, np.where(wrong_first, from_last + ways, np.where(wrong_last, first + ways, tails))


def _steps_of(way: Ints, counts: Ints | int) -> Floats:
    """How far the rotor turns from the last sample of each packet to the next sample, if nothing is missing."""
    inner = np.broadcast_to(np.subtract(counts, 1), way.shape)
    long = (inner >= min(_FEWEST_STEPS, int(inner.max()))).nonzero()[0]
    # The rotor may turn by less than the headings resolve: at least one unit is taken.
    own: Floats = np.maximum(way[long], 1) / inner[long]
    if len(own) > 1:
        # A step that is like none beside it is damaged: keep each between its neighbours.
        before, after = np.append(own[1], own[:-1]), np.append(own[1:], own[-2])
        own = np.maximum(np.minimum(before, after), np.minimum(own, np.maximum(before, after)))
        own[:-1] = np.maximum(own[:-1], own[1:])
    # A short packet has the step of the long one before it.
    return own[np.maximum(np.searchsorted(long, np.arange(len(way)), "right") - 1, 0)]
