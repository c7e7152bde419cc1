"""How many packets a device has measured by the time between those that came, against a slow way to tell it."""

from collections.abc import Sequence

import numpy as np
import pytest

from lidario.families.pace import Pace
from lidario.wire.events import Arrival

TURN = 7000
Call = tuple[list[int], list[Arrival]]
Point = tuple[int, int, int]


def points_of(calls: Sequence[Call]) -> list[Point]:
    """When the last packet of each read came, where the rotor was then, and which packet it was."""
    spans = [span for these, _ in calls for span in these]
    points: list[Point] = []
    before = 0
    for these, arrivals in calls:
        for count, at_ns in arrivals:
            packet = before + count - 1
            # Of those that came at once, only the last one came just then.
            points = [point for point in points if point[0] != at_ns]
            points.append((at_ns, sum(spans[:packet]), packet + 1))
        before += len(these)
    return points[-64:]


def halves(points: Sequence[Point], packet_ns: int, *, stood: bool) -> list[tuple[float, int, int]]:
    """What was measured, turned and came in each half of the time, with that in which it `stood` or without."""
    if len(points) < 3:
        return []
    steps = np.diff(np.array(points), axis=0)
    turning = steps[steps[:, 1] > 0]
    if len(turning):
        # Of an even number the quicker one of both in the middle.
        turn_ns = TURN * np.percentile(turning[:, 0] / turning[:, 1], 50, method="lower")
        # There a whole turn hides, or a leap that was none.
        steps[np.abs(steps[:, 0] - steps[:, 1] / TURN * turn_ns) > turn_ns / 2] = 0
        steps[(steps[:, 1] == 0) & (not stood)] = 0
    points = [points[0], *(tuple(each) for each in (points[0] + np.cumsum(steps, axis=0)).tolist())]
    times = np.array([at_ns for at_ns, _, _ in points])
    middle = points[int(np.argmin(np.abs(times - (times[0] + times[-1]) / 2)))]
    return [
        ((to_ns - from_ns) / packet_ns, to_turned - from_turned, to_came - from_came)
        for (from_ns, from_turned, from_came), (to_ns, to_turned, to_came) in (
            (points[0], middle),
            (middle, points[-1]),
        )
    ]


def measured(points: Sequence[Point], packet_ns: int, arc: float) -> tuple[float, float] | None:
    """As `Pace.measured`."""
    arcs = [
        (packets, turned / arc if arc else came) for packets, turned, came in halves(points, packet_ns, stood=False)
    ]
    found = [packets / each for packets, each in arcs if packets >= 8 and each > 0]
    return (found[0], found[1]) if len(found) == 2 else None


def is_too_short(points: Sequence[Point], packet_ns: int, arc: float) -> bool:
    """As `Pace.is_too_short`."""
    found = halves(points, packet_ns, stood=True)
    short = [4 <= packets < min(1.5 * came, 0.75 * turned / arc - 1) for packets, turned, came in found]
    packets, turned, came = np.sum(found, axis=0) if found else (0, 0, 0)
    far = max(8, 0.75 * came) <= packets < 0.5 * turned / arc - 1
    return len(found) == 2 and (far or all(short))


def calls_of(random: np.random.Generator) -> list[Call]:
    """Some packets at a time, in some reads; a read may go on in the next call, and some packets are far apart."""
    calls, now = list[Call](), 10**9
    for _ in range(int(random.integers(1, 40))):
        count = int(random.integers(1, 9))
        spans = random.choice([460, 920, 1500, 5000], count).tolist()
        if random.random() < 0.05:
            spans[int(random.integers(count))] = TURN - 1
        ends = sorted({*random.integers(1, count + 1, 2).tolist(), count})
        arrivals: list[Arrival] = []
        for end in ends:
            now += int(random.integers(1, 5_000_000)) if arrivals or random.random() < 0.8 else 0
            arrivals.append((end, now))
        calls.append((spans, arrivals))
    return calls


@pytest.mark.exhaustive("seed", sample=range(20), full=range(60))
def test_it_knows_what_a_slow_way_tells(seed: int) -> None:
    random, pace, calls, points = np.random.default_rng(seed), Pace(TURN), list[Call](), list[Point]()
    for spans, arrivals in calls_of(random):
        pace.add(spans, arrivals)
        calls.append((spans, arrivals))
        points = points_of(calls)
        for packet_ns, arc in ((300_000, 0.0), (300_000, 460.0), (2_000_000, 920.0)):
            assert pace.measured(packet_ns, arc) == pytest.approx(measured(points, packet_ns, arc))
        for packet_ns, arc in ((2_000_000, 230.0), (600_000, 920.0), (600_000, 400.0)):
            assert pace.is_too_short(packet_ns, arc) == is_too_short(points, packet_ns, arc)
        assert pace.measured(0, 460.0) is None
    twin, doubted = pace.copy(), pace.copy()
    pace.clear()
    assert pace.measured(300_000, 460.0) is None
    assert twin.measured(300_000, 460.0) == pytest.approx(measured(points, 300_000, 460.0))
    doubted.doubt_last()
    latest = ([920, 460], [(2, points[-1][0] + 4_000_000)])
    doubted.add(*latest)
    points[-1:] = points_of([*calls, latest])[-1:]
    assert doubted.measured(300_000, 460.0) == pytest.approx(measured(points, 300_000, 460.0))
