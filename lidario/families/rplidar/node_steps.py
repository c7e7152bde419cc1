"""What is missing among the nodes of 0x81, each of which is a packet of its own.

The step from one node to the next is a few units of the angle, and angles are corrected: steps scatter by most of
one, and are even only in the mean. So what holds for the arcs of larger packets (`lidario.families.wheel`) holds
for the mean of a few dozen steps:

1. **It is like the one before it.** In a few milliseconds a rotor changes its speed by a small part of the greatest
   one, whatever it does.
2. **What is not** is missing nodes; what is not for long is another speed. What leaps ahead and falls back is
   neither: behind an edge that is near, angles are corrected by more than behind one that is far.
3. **The clock has the last word** where steps agree: they are one each, or a whole number of them.

A node has two check bits, so that a few bytes may pass for one whose angle is somewhere else.

Where the angles leap, it may be that they are those of returns beside the beam (`chains`): then the beams count, if
they are much evener.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median_high
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families.pace import OFF, PacedTurning
from lidario.families.rplidar.chains import FULL_TURN_Q6, beams_of
from lidario.families.spans import Arcs, Heads, Ints, by_revolution, spans_between
from lidario.wire.events import Arrival

Steps = NDArray[np.float64]

RETREAT_TURNS: Final = 1 / 12
"""How far nodes fall back at most: without a check value, a few bytes may pass for nodes up to 30 degrees ahead."""
_RETREAT_Q6: Final = round(RETREAT_TURNS * FULL_TURN_Q6)
JITTER: Final = 0.75
"""Share of an ordinary step by which steps may scatter: only a doubled one is a lost node."""
SEVERAL: Final = 32
"""Steps of which the mean is taken, in a few milliseconds. That of seven units is off by half a percent, since each
end is rounded. Of more steps, a rotor that starts would be much faster in the last than in the first."""
CHANGE: Final = 0.1
"""Part of the longest ordinary step of a revolution by which any other may differ from the one before: the slower a
rotor turns, the more any change is for it."""
STRANGE: Final = 32
"""Of so many times those steps, hardly one is like those before: if time tells nothing, it is another speed."""
CERTAIN_STEPS: Final = 6
"""Steps that must agree before the ordinary one is certain."""
FALSE_NODES: Final = 40
"""Nodes within which a leap and a fall belong together: between them stands what was no node."""
_CORRECTED_TURNS: Final = 1 / 45
"""How far angles are corrected at most: 8 degrees in the vendor's SDK 2.1.0, which does it for other formats."""


class Nodes(NamedTuple):
    """Nodes as they were read."""

    rows: NDArray[Any]  # of the layout `lidario.families.rplidar.nodes.NODE`
    following: bytes | None  # the one behind them; None where it is not known

    def beams(self, heads: Heads) -> Heads:
        """Where the beams were, if the angles in `heads` are those of returns beside them."""
        rows = self.rows
        if self.following is not None:
            rows = np.concatenate((rows, np.frombuffer(self.following, rows.dtype, 1)))
        beams = beams_of((rows["angle"] >> 1).astype(np.int32), rows["distance"])
        told = np.flatnonzero((rows["distance"] > 0) | (rows["quality"] >> 2 == 0))
        if 2 <= len(told) < len(rows):
            beams = _between(beams[told], told, len(rows))
        following = None if self.following is None else int(beams[-1])
        return heads._replace(first=beams[: len(self.rows)], following=following)


class NodeSteps(PacedTurning):
    """Follows the nodes of one stream."""

    def __init__(self, full_turn: int) -> None:
        super().__init__(full_turn, RETREAT_TURNS)
        self._typical = 0.0

    def follow(self, heads: Heads, arrivals: Sequence[Arrival] = ()) -> Arcs:
        followed = heads.following is not None
        spans, shortest, longest, total = spans_between(heads, self._full_turn, self._retreat)
        if isinstance(heads.read, Nodes) and not self._is_ordinary(self._typical, shortest, longest):
            beams = spans_between(heads.read.beams(heads), self._full_turn, self._retreat)
            # Damage alone makes either a little evener.
            if 2 * _unevenness(beams[0]) < _unevenness(spans):
                spans, shortest, longest, total = beams
        if self._certain and followed and self._is_ordinary(self._typical, shortest, longest):
            # The mean is as good as the median where nothing is far from either, and much cheaper.
            self._typical, self._strange = total / len(spans), 0
            times = self._corrected(spans, arrivals, 1.0)
            if times == 1:
                self._note_close(len(spans))
                return Arcs(spans, None, total / len(spans), certain=True)
            steps, missing = self._walk(spans, followed=followed)
        else:
            steps, missing = self._walk(spans, followed=followed)
            if not self._certain:
                # As where the rotor stands, or has just begun to turn: the mean of its steps tells of no gap.
                return Arcs(np.maximum(spans, 0.0), None, 0.0, certain=False)
            times = self._corrected(spans, arrivals, 1 + float(missing.mean()))
            if times != 1:
                steps, missing = self._walk(spans, followed=followed)
            elif not missing.any():
                self._note_close(len(spans) - (not followed))
        skipped = missing if missing.any() else None
        # Where the rotor stood all the time, nodes tell of no step.
        step = float(steps.mean()) or self._typical
        return Arcs(spans, skipped, step, self._certain, self._revoked(times))

    def follow_several(
        self,
        heads: Heads,
        ends: Sequence[int],
        arrivals: Sequence[Arrival] = (),  # noqa: ARG002
    ) -> Arcs | None:
        if not self._certain:
            return None
        spans, _, _, _ = spans_between(heads, self._full_turn, self._retreat)
        typical, begin, steps = self._typical, 0, list[float]()
        for end, (shortest, longest, total) in zip(ends, by_revolution(spans, ends), strict=True):
            if not self._is_ordinary(typical, shortest, longest):
                return None
            typical, begin = total / (end - begin), end
            steps.append(typical)
        self._typical, self._strange = typical, 0
        self._pace.clear()
        return Arcs(spans, None, typical, certain=True, steps=steps)

    @staticmethod
    def _is_ordinary(typical: float, shortest: int, longest: int) -> bool:
        return JITTER * typical < shortest and longest <= (1 + JITTER) * typical

    def _corrected(self, spans: Ints, arrivals: Sequence[Arrival], each: float) -> float:
        """Correct the ordinary step where the device has measured a multiple or a part of the nodes that it tells.

        It tells `each` for one that came, with those that are missing. Returns how many times too long the step
        was; 1 where time does not speak against it.
        """
        if self._confirmed and not self._strange:
            self._pace.clear()
            return 1.0
        self._pace.add(spans, arrivals)
        by_time = self._pace.measured(self._packet_ns)
        if by_time is None:
            return 1.0
        low, high = min(by_time) / each, max(by_time) / each
        # In a file no time passes where nodes are missing: it cannot tell of fewer.
        fewer = 1 / max(1, round(1 / high)) if self._time_passes else 1.0
        for times in (max(1, round(low)), fewer):
            if times > max(1.0, self._typical):
                # Angles are whole numbers: no step is that small, whatever time seems to tell.
                continue
            if high <= (1 + OFF) * times and low >= (1 - OFF) * times:
                if times != 1:
                    self._typical /= times
                elif self._strange and 2 * np.count_nonzero(spans > 0) > len(spans):
                    # It tells the right number of nodes, though hardly a step is like it: so long they are, unless
                    # the rotor stood.
                    self._typical = float(spans.mean()) / each
                self._confirmed, self._strange = True, 0
                self._pace.clear()
                return times
        return 1.0

    def _walk(self, spans: Ints, *, followed: bool) -> tuple[Steps, NDArray[np.intp]]:
        """The ordinary step at each node, and how many are missing behind it."""
        rough = spans.astype(np.float64)
        known = rough if followed else rough[:-1]
        if not self._certain and len(known):
            self._learn_first(known)
        steps = np.full(len(rough), self._typical)
        # The last few may be gaps alone.
        whole = [part for part in _parts(known, SEVERAL) if len(part) >= CERTAIN_STEPS]
        greatest = max([self._typical, *map(_short, whole)])
        # Steps are rounded, and those of a rotor that starts grow by about one until the next few dozen.
        slack = CHANGE * greatest + 2
        chunks = _parts(known, SEVERAL)
        for begin, chunk in zip(range(0, len(known), SEVERAL), chunks, strict=True):
            self._take(chunk, slack)
            steps[begin : begin + SEVERAL] = self._typical
        missing = _missing(rough, steps, slack / JITTER, _CORRECTED_TURNS * self._full_turn)
        for begin, chunk in zip(range(0, len(known), SEVERAL), chunks, strict=True):
            if np.abs(chunk).max() < steps[begin] / 2:
                # The rotor all but stood: this revolution has so many samples more.
                steps[begin : begin + SEVERAL] = chunk.mean()
        return steps, missing

    def _take(self, spans: Steps, slack: float) -> None:
        """Find the ordinary step of a few dozen, by the one before."""
        near = spans[np.abs(spans - self._typical) <= max(self._typical / 2, slack)]
        if len(near) >= CERTAIN_STEPS:
            # A rotor that stands tells of no step.
            self._typical, self._strange = float(near.mean()) or self._typical, 0
            return
        middle, agreeing = _middle(spans)
        if agreeing < CERTAIN_STEPS or 2 * agreeing < len(spans):
            return
        self._strange += len(spans)
        if self._strange >= STRANGE * SEVERAL and middle > 0:
            self._typical, self._strange = middle, 0

    def _learn_first(self, spans: Steps) -> None:
        """The ordinary step as long as none is certain."""
        short = _short(spans)
        ordinary = spans[np.abs(spans - short) <= abs(short) / 2]
        self._typical, _ = _middle(ordinary)
        self._certain = len(ordinary) >= CERTAIN_STEPS and self._typical > 0


def _between(beams: Ints, told: NDArray[np.intp], count: int) -> NDArray[np.int32]:
    """Where so many beams were of which some are told: evenly between those, but for nodes that are missing.

    Of a gap nothing tells where it is; it is told before the next beam that is known.
    """
    counts = np.diff(told)
    arcs = (np.diff(beams) + _RETREAT_Q6) % FULL_TURN_Q6 - _RETREAT_Q6
    beside = arcs[counts == 1]
    usual = float(np.median(beside)) if len(beside) else float(arcs.sum() / counts.sum())
    missing = np.ceil(arcs / max(1.0, usual) - counts - JITTER)
    each = arcs / (counts + np.maximum(missing, 0.0))
    places = np.arange(count)
    before = np.clip(np.searchsorted(told, places, "right") - 1, 0, len(each) - 1)
    along = np.concatenate(((0,), np.cumsum(arcs)))
    way = along[before] + (places - told[before]) * each[before]
    way[told] = along
    way[told[-1] :] = along[-1] + (places[told[-1] :] - told[-1]) * usual
    found: NDArray[np.int32] = (np.rint(way + beams[0]) % FULL_TURN_Q6).astype(np.int32)
    return found


def _unevenness(spans: Ints) -> float:
    return float(np.abs(spans - np.median(spans)).sum())


def _parts(spans: Steps, size: int) -> list[Steps]:
    return [spans[begin : begin + size] for begin in range(0, len(spans), size)]


def _short(spans: Steps) -> float:
    """One of the shorter ones. Gaps only ever lengthen a step, so these tell the truth."""
    return float(np.sort(spans)[len(spans) // 4])


def _middle(spans: Steps) -> tuple[float, int]:
    """The ordinary one of several steps, and how many agree with it."""
    median = median_high(spans.tolist())
    # A step is a few units: one of 7.2 is 7 or 8, and the median 7.
    near = spans[np.abs(spans - median) <= abs(median) / 2]
    return float(near.mean()), len(near)


def _missing(spans: Steps, steps: Steps, least: float, corrected: float) -> NDArray[np.intp]:
    """Nodes missing behind each, by the ordinary step at each.

    A rotor that turns by less than `least` from node to node all but stands; angles are `corrected` by so much at
    most.
    """
    moved = np.maximum(steps, least)
    times = spans / moved
    missing = np.ceil(times - 1 - JITTER).astype(np.intp)
    leaps = missing > 0
    # A leap beside a fall is one heading that is out of place, not a gap.
    falls = spans < 0
    missing[1:][falls[:-1]] = 0
    missing[:-1][falls[1:]] = 0
    # Where headings leap ahead and soon fall back, only the difference is missing.
    for fall in np.flatnonzero(spans < -2 * moved).tolist():
        before = np.flatnonzero(missing[max(0, fall - FALSE_NODES) : fall] > 0)
        if len(before):
            leap = max(0, fall - FALSE_NODES) + int(before[-1])
            missing[leap] += round(float(times[fall]))
    missing = np.maximum(missing, 0)
    # So it is anywhere where a correction may be the cause. One that stands may be the one before once more; a gap
    # that is larger than others is the likelier one.
    falls = (times < 1 - JITTER) & (spans != 0) & (spans > -corrected)
    false = int(missing.sum()) - round(float((times - 1)[falls | leaps].sum()))
    if falls.any():
        order = np.argsort(missing, kind="stable")
        missing[order] = np.clip(np.cumsum(missing[order]) - false, 0, missing[order])
    return missing
