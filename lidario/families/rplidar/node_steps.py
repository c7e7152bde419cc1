"""Finds what is missing among the nodes of 0x81, each of which is a packet of its own.

The step from one node to the next is a few units of the angle, and angles are corrected. So single steps scatter by
most of a step, and only their mean is even. The rules for the arcs of larger packets (`lidario.families.wheel`)
hold here for the mean of a few dozen steps:

1. **A mean step is like the one before it.** Whatever a rotor does, in a few milliseconds its speed changes by only
   a small part of the greatest speed.
2. **A step that is not like it** shows missing nodes; many such steps show another speed. An angle that leaps ahead
   and falls back shows neither: behind a near edge, angles are corrected by more than behind a far one.
3. **The clock has the last word** if steps agree: each is one ordinary step, or a whole number of them.

A node has only two check bits, so a few bytes may pass for a node with any angle.

If the angles leap, they may be those of returns beside the beam (`chains`). Then the angles of the beams are used,
if they are much more even.
"""

from collections.abc import Sequence
from statistics import fmean, median_high
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families.pace import OFF, PacedTurning
from lidario.families.rplidar.chains import FULL_TURN_Q6, beams_of
from lidario.families.spans import Arcs, Heads, Ints, by_revolution, extent, spans_between
from lidario.wire.events import Arrival

Steps = NDArray[np.float64]

RETREAT_TURNS: Final = 1 / 12
"""Nodes fall back by this at most: without a check value, a few bytes may pass for nodes up to 30 degrees ahead."""
_RETREAT_Q6: Final = round(RETREAT_TURNS * FULL_TURN_Q6)
JITTER: Final = 0.75
"""Share of an ordinary step by which steps may scatter: only a doubled step shows a lost node."""
SEVERAL: Final = 32
"""Steps over which the mean is taken, which take a few milliseconds. A mean step of seven units is off by half a
percent then, since each end is rounded. Over more steps, a starting rotor would speed up too much on the way."""
CHANGE: Final = 0.1
"""An ordinary step may differ from the one before by this part of the longest one of the revolution. Not by a part
of itself, since a change weighs more for a slow rotor."""
STRANGE: Final = 32
"""If time says nothing, another speed is taken after this many groups of steps that are hardly like those
before."""
CERTAIN_STEPS: Final = 6
"""This many steps must agree before the ordinary step is certain."""
FALSE_NODES: Final = 40
"""A leap and a fall within this many nodes belong together: the bytes between were no nodes."""
_CORRECTED_TURNS: Final = 1 / 45
"""Largest correction of angles: 8 degrees in the vendor's SDK 2.1.0, which makes it for other formats."""


class Nodes(NamedTuple):
    """Nodes as they were read."""

    rows: NDArray[Any]  # of the layout `lidario.families.rplidar.nodes.NODE`
    following: bytes | None  # the node behind them; None if unknown

    def beams(self, heads: Heads) -> Heads:
        """Where the beams are, if the angles in `heads` are those of returns beside the beams.

        Only what is between two of them is to be used: mostly they are counted from the first return.
        """
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
        count = len(spans) - (not followed)
        if count and not followed:
            shortest, longest, total = extent(spans[:-1])
        # Steps that are all like their mean show no gap, nor another speed.
        usual = self._typical if self._certain else total / max(1, count)
        if isinstance(heads.read, Nodes) and not self._is_ordinary(usual, shortest, longest):
            beams = spans_between(heads.read.beams(heads), self._full_turn, self._retreat)
            # Much more even, since damage alone may make the beams a little more even.
            if 2 * _unevenness(beams[0]) < _unevenness(spans):
                spans, shortest, longest, total = beams
        if (self._certain or count >= CERTAIN_STEPS) and self._is_ordinary(usual, shortest, longest):
            # With no step far off, the mean is as good as the median, and much cheaper.
            self._typical, self._certain, self._strange = total / count, True, 0
            times = self._corrected(spans, arrivals, 1.0)
            if times == 1:
                self._note_close(count)
                return Arcs(spans, None, total / count, certain=True)
            steps, missing = self._walk(spans, followed=followed)
        else:
            before = self._typical
            steps, missing = self._walk(spans, followed=followed)
            if not self._certain:
                # The rotor stands, or has just begun to turn: the mean of its steps shows no gap then.
                return Arcs(np.maximum(spans, 0.0), None, 0.0, certain=False)
            times = self._corrected(spans, arrivals, 1 + float(missing.mean()))
            if times != 1:
                steps, missing = self._walk(spans, followed=followed)
                self._strange = 0  # time has just said that these steps are gaps
            elif self._strange >= STRANGE * SEVERAL and not self._time_may_tell:
                # Time says nothing, so the steps are believed; it may correct them when it tells more.
                self._typical, self._confirmed = before, False
                steps, missing = self._walk(spans, followed=followed, anew=True)
            elif not missing.any():
                self._note_close(count)
        skipped = missing if missing.any() else None
        # If the rotor stood all the time, nodes show no step: keep the last one.
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

    @property
    def _time_may_tell(self) -> bool:
        """Whether too few reads have come as yet, but time passes between them."""
        return self._packet_ns > 0 and self._time_passes and self._pace.measured(self._packet_ns) is None

    def _corrected(self, spans: Ints, arrivals: Sequence[Arrival], each: float) -> float:
        """Correct the ordinary step if time says that there were a multiple or a part of the nodes that it implies.

        By the ordinary step there were `each` nodes, with the missing ones, for every node that came. Returns how
        many times too long the step was; 1 if time does not disprove it.
        """
        if self._confirmed and not self._strange:
            self._pace.clear()
            return 1.0
        self._pace.add(spans, arrivals)
        by_time = self._pace.measured(self._packet_ns)
        if by_time is None:
            return 1.0
        low, high = min(by_time) / each, max(by_time) / each
        # In a file, no time passes while nodes are missing, so it cannot show that there were fewer.
        fewer = 1 / max(1, round(1 / high)) if self._time_passes else 1.0
        for times in (max(1, round(low)), fewer):
            if times > max(1.0, self._typical):
                # Angles are whole numbers, so no step is that small, whatever time seems to say.
                continue
            if high <= (1 + OFF) * times and low >= (1 - OFF) * times:
                if times != 1:
                    self._typical /= times
                elif self._strange and 2 * np.count_nonzero(spans > 0) > len(spans):
                    # The number of nodes is right, though hardly a step is like the ordinary one: take the mean
                    # step, unless the rotor stood.
                    self._typical = float(spans.mean()) / each
                self._confirmed, self._strange = True, 0
                self._pace.clear()
                return times
        return 1.0

    def _walk(self, spans: Ints, *, followed: bool, anew: bool = False) -> tuple[Steps, NDArray[np.intp]]:
        """The ordinary step at each node, and how many nodes are missing behind it; with `anew`, by steps alone."""
        rough = spans.astype(np.float64)
        known = (spans if followed else spans[:-1]).tolist()
        if not self._certain and known:
            self._learn_first(known)
        steps, longest = np.full((2, len(rough)), self._typical)
        # Lists, since an array takes longer for each of so few.
        chunks = [known[begin : begin + SEVERAL] for begin in range(0, len(known), SEVERAL)]
        # Without the last few steps, which may all be gaps.
        greatest = max([0.0, self._typical, *(_short(chunk) for chunk in chunks if len(chunk) >= CERTAIN_STEPS)])
        # Plus 2: steps are rounded, and those of a starting rotor grow by about one from one mean to the next.
        slack = CHANGE * greatest + 2
        for number, chunk in enumerate(chunks):
            before, here = self._typical, slice(number * SEVERAL, (number + 1) * SEVERAL)
            self._take(chunk, slack, anew=anew)
            steps[here] = self._typical
            # If the rotor slows down that fast, the first steps of the chunk are still as long as those before it.
            is_slowing = before - self._typical > CHANGE * before
            longest[here] = before if is_slowing else self._typical
        missing = _missing(rough, longest, slack / JITTER, _CORRECTED_TURNS * self._full_turn)
        for number, chunk in enumerate(chunks):
            begin = number * SEVERAL
            if max(max(chunk), -min(chunk)) < steps[begin] / 2:
                # The rotor all but stood: its own small steps count, for the revolution has that many more samples.
                steps[begin : begin + SEVERAL] = fmean(chunk)
        return steps, missing

    def _take(self, spans: list[int], slack: float, *, anew: bool) -> None:
        """Find the ordinary step of a few dozen steps, by the ordinary step before, or `anew`."""
        near = _near(spans, self._typical, max(self._typical / 2, slack))
        if len(near) >= CERTAIN_STEPS:
            # A rotor that stands shows no step: keep the last one.
            self._typical, self._strange = sum(near) / len(near) or self._typical, 0
            return
        middle, agreeing = _middle(spans)
        if agreeing < CERTAIN_STEPS or 2 * agreeing < len(spans) or middle <= 0:
            return
        self._strange += len(spans)
        if anew:
            self._typical, self._strange = middle, 0

    def _learn_first(self, spans: list[int]) -> None:
        """Find the ordinary step while none is certain."""
        short = _short(spans)
        ordinary = _near(spans, short, abs(short) / 2)
        self._typical, _ = _middle(ordinary)
        self._certain = len(ordinary) >= CERTAIN_STEPS and self._typical > 0


def _between(beams: Ints, told: NDArray[np.intp], count: int) -> NDArray[np.int32]:
    """How far `count` beams are behind the first that is `told`: the others lie evenly between the told ones.

    If nodes are missing between two told beams, it is not known where. The gap is placed right before the second.
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
    found: NDArray[np.int32] = np.rint(way).astype(np.int32)
    return found


def _unevenness(spans: Ints) -> float:
    return float(np.abs(spans - np.median(spans)).sum())


def _short(spans: list[int]) -> int:
    """One of the shorter steps. Gaps only lengthen steps, so the short ones are right."""
    return sorted(spans)[len(spans) // 4]


def _near(spans: list[int], step: float, within: float) -> list[int]:
    least, most = step - within, step + within
    if least <= min(spans) and max(spans) <= most:  # as mostly; much faster than to look at each
        return spans
    return [span for span in spans if least <= span <= most]


def _middle(spans: list[int]) -> tuple[float, int]:
    """The ordinary step among several, and how many agree with it."""
    median = median_high(spans)
    # The mean of those near the median: a step of 7.2 units appears as 7 or 8, and the median as 7.
    near = _near(spans, median, abs(median) / 2)
    return fmean(near), len(near)


def _missing(spans: Steps, steps: Steps, least: float, corrected: float) -> NDArray[np.intp]:
    """How many nodes are missing behind each, by the ordinary step at each.

    A rotor that turns by less than `least` from node to node all but stands; angles are corrected by at most
    `corrected`.
    """
    moved = np.maximum(steps, least)
    times = spans / moved
    missing = np.ceil(times - 1 - JITTER).astype(np.intp)
    leaps = missing > 0
    # A leap next to a fall is one heading that is out of place, not a gap.
    falls = spans < 0
    missing[1:][falls[:-1]] = 0
    missing[:-1][falls[1:]] = 0
    # If headings leap ahead and soon fall back, only the difference is missing.
    back = np.flatnonzero(spans < -2 * moved)
    coming, open_leaps = np.flatnonzero(missing > 0)[::-1].tolist(), list[int]()
    # It calls nothing where no leap comes: where angles run backwards, each node of the longest revolution falls.
    for fall, by in zip(back.tolist(), times[back].tolist(), strict=True):
        while coming and coming[-1] < fall:
            open_leaps.append(coming.pop())
        while open_leaps and missing[open_leaps[-1]] <= 0:
            open_leaps.pop()
        if open_leaps and open_leaps[-1] >= fall - FALSE_NODES:
            missing[open_leaps[-1]] += round(by)
    missing = np.maximum(missing, 0)
    # The same holds at any distance for a fall that a correction may explain. A step of 0 does not count: it may be
    # a doubled node. The larger a gap is, the more likely it is real, so the smaller ones are reduced first.
    falls = (times < 1 - JITTER) & (spans != 0) & (spans > -corrected)
    false = int(missing.sum()) - round(float((times - 1)[falls | leaps].sum()))
    if falls.any():
        order = np.argsort(missing, kind="stable")
        missing[order] = np.clip(np.cumsum(missing[order]) - false, 0, missing[order])
    return missing
