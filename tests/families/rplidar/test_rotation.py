"""How far the rotor turned in each packet, and what is missing between two."""

import sys
from collections.abc import Callable
from itertools import accumulate

import numpy as np
import pytest
from numpy.typing import NDArray

from lidario.families.rplidar.node_steps import NodeSteps
from lidario.families.spans import Heads
from tests.support.wheels import heads, lost, missing

TURN = 23040


def headings(*angles: int) -> NDArray[np.int32]:
    return np.array([angle % TURN for angle in angles], np.int32)


def nodes_of(step: int, count: int = 140) -> Heads:
    """Nodes that far apart."""
    return heads(headings(*(step * at for at in range(count))), step * count % TURN)


def knowing(step: int) -> NodeSteps:
    """A model that has followed nodes so far apart."""
    rotation = NodeSteps(TURN)
    rotation.follow(nodes_of(step))
    return rotation


ORDINARY: dict[str, Callable[[NodeSteps, int], object]] = {
    "all there": lambda rotation, step: rotation.follow(nodes_of(step)),
    "one missing": lambda rotation, step: rotation.follow(steps_of(2 * step, *[step] * 41)),
    "a whole revolution": lambda rotation, step: rotation.follow_several(nodes_of(step), [140]),
}


@pytest.mark.parametrize("between", ORDINARY)
@pytest.mark.parametrize(("step", "other"), [(7, 20), (5, 15), (7, 21), (40, 120)])
def test_another_step_is_believed_the_32nd_time_in_a_row(step: int, other: int, between: str) -> None:
    rotation = knowing(step)
    for _ in range(5):
        rotation.follow(nodes_of(other, 32))
    ORDINARY[between](rotation, step)
    *told, last, behind = [lost(rotation.follow(nodes_of(other, 32))) for _ in range(33)]
    assert (told, behind) == ([2 * 32] * 31, 0)
    assert last < 2 * 32


def steps_of(*steps: int) -> Heads:
    """Nodes so far apart, and one behind them."""
    *angles, following = accumulate(steps, initial=0)
    return heads(headings(*angles), following % TURN)


def test_where_angles_run_backwards_a_node_costs_less_than_a_call() -> None:
    """In a revolution that never ends thousands fall back, and the event loop stood still meanwhile."""
    rotation, called = knowing(7), 0

    def count(frame: object, event: str, argument: object) -> None:
        nonlocal called
        called += event in ("call", "c_call")

    nodes = steps_of(*[-20] * 3000)
    sys.setprofile(count)
    try:
        rotation.follow(nodes)
    finally:
        sys.setprofile(None)
    assert called < 3000


@pytest.mark.parametrize("step", [-1, -20, -30])
def test_angles_that_only_run_backwards_tell_no_speed(step: int) -> None:
    arcs = NodeSteps(TURN).follow(steps_of(*[step] * 400))
    assert (arcs.certain, arcs.skipped, arcs.step) == (False, None, 0.0)


@pytest.mark.parametrize("timed", [True, False])
def test_time_tells_that_each_second_node_is_lost_though_steps_are_even(timed: bool) -> None:
    rotation, now, told = NodeSteps(TURN), 0, list[int]()
    if timed:
        rotation.tell_time(31_250.0)
    # What has no times tells a step; then time tells that it is two, of those it came with too.
    rotation.follow(nodes_of(14))
    for _ in range(4):
        ends = range(28, 141, 28)
        arcs = rotation.follow(nodes_of(14), [(end, now + 62_500 * end) for end in ends])
        told.append(lost(arcs))
        now += 62_500 * 140
    assert told == ([140] * 4 if timed else [0] * 4)


@pytest.mark.parametrize("followed", [True, False])
@pytest.mark.parametrize("turns", [0, 2])
def test_what_was_told_before_time_tells_is_revoked(turns: int, followed: bool) -> None:
    """Of each two nodes that were told to follow each other; the last one follows no other where none is behind."""
    rotation, before = NodeSteps(TURN), nodes_of(14)
    rotation.tell_time(31_250.0)
    for _ in range(turns):
        rotation.follow(before)
    rotation.follow(before if followed else before._replace(following=None))
    arcs = rotation.follow(nodes_of(14), [(end, 62_500 * end) for end in range(28, 141, 28)])
    assert arcs.revoked == (1, 140 * turns + 139 + followed)


def test_several_revolutions_are_steady_where_each_is() -> None:
    rotation = NodeSteps(TURN)
    assert rotation.follow_several(nodes_of(7, 280), [140, 280]) is None
    rotation.follow(nodes_of(7))
    for second, steps in ((7, [7, 7]), (10, [7, 10]), (14, None)):
        arcs = rotation.copy().follow_several(steps_of(*[7] * 140, *[second] * 140), [140, 280])
        assert (None if arcs is None else arcs.steps) == steps
    twin = rotation.copy()
    twin.follow(nodes_of(10))
    assert [lost(each.follow(steps_of(*[10] * 9, 20))) for each in (twin, rotation)] == [1, 1]
    assert [lost(each.copy().follow(steps_of(7, 7, 17, 7))) for each in (twin, rotation)] == [0, 0]


@pytest.mark.parametrize(
    ("first", "missing_there"), [([6, 9] * 20 + [13], 0), ([6, 9] * 20 + [14], 1), ([7, 7, 12, 2, 7] * 8, 0)]
)
def test_steps_within_half_of_the_ordinary_one_are_of_one_speed(first: list[int], missing_there: int) -> None:
    """Their mean is the ordinary one, of the first ones too."""
    arcs = NodeSteps(TURN).follow(steps_of(*first))
    assert (arcs.certain, lost(arcs)) == (True, missing_there)
    rotation = knowing(7)
    assert lost(rotation.follow(steps_of(*[10] * 60, 20, *[10] * 60))) == 1


@pytest.mark.parametrize("nodes", [96, 97, 100])
def test_a_wide_gap_among_the_last_nodes_is_counted_by_the_steps_before(nodes: int) -> None:
    """Steps are looked at 32 by 32; a gap may stand alone behind these."""
    rotation = knowing(70)
    assert lost(rotation.follow(steps_of(*[70] * nodes, 70 * 51))) == 50


@pytest.mark.parametrize(("back", "gone"), [(1900, 0), (1950, 3012)])
def test_nodes_fall_back_by_30_degrees_at_most(back: int, gone: int) -> None:
    rotation = knowing(7)
    assert lost(rotation.follow(steps_of(*[7] * 50, -back, *[7] * 50))) == pytest.approx(gone, abs=2)


def test_a_node_that_stands_hides_no_gap_beside_it() -> None:
    """Only one that is out of place does, which falls back."""
    rotation = knowing(7)
    for before, behind in ((0, 21), (21, 0)):
        assert lost(rotation.follow(steps_of(*[7] * 50, before, behind, *[7] * 50))) == 2


def test_steps_that_do_not_agree_are_no_other_speed() -> None:
    """Of each four there is one alike, however often they come."""
    rotation = knowing(7)
    for _ in range(40):
        rotation.follow(steps_of(*[20, 45, 100, 200] * 32))
    assert lost(rotation.follow(nodes_of(14))) == 140


@pytest.mark.parametrize("reads", [1, 2, 50])
def test_time_goes_on_telling_it_in_revolutions_of_many_nodes(reads: int) -> None:
    """One has more of them than another step would need to be believed, if time said nothing."""
    rotation, now, told = NodeSteps(TURN), 0, list[int]()
    rotation.tell_time(31_250.0)
    for _ in range(12):
        arrivals = []
        for end in range(1600 // reads, 1601, 1600 // reads):
            now += 1600 // reads * 2 * 31_250
            arrivals.append((end, now))
        told.append(lost(rotation.follow(nodes_of(14, 1600), arrivals)))
    assert told[3:] == [1600] * 9


def test_another_speed_may_have_steps_that_scatter() -> None:
    rotation = knowing(7)
    for _ in range(33):
        rotation.follow(steps_of(*[20, 40, 40] * 46))
    assert lost(rotation.follow(steps_of(*[20, 40, 40] * 46))) == 0


def test_time_that_says_first_this_and_then_that_confirms_no_step() -> None:
    """Later it says twice that each second node is lost."""
    rotation, now, told = NodeSteps(TURN), 0, list[int]()
    rotation.tell_time(31_250.0)
    for fast in (70, 0, 0, 0):
        arrivals = []
        for end in range(4, 141, 4):
            now += 4 * (31_250 if end < fast else 62_500)
            arrivals.append((end, now))
        arcs = rotation.follow(nodes_of(14), arrivals)
        told.append(lost(arcs))
        assert fast == 0 or arcs.revoked == (0, 0)
    assert (told[0], told[-1]) == (0, 140)


@pytest.mark.parametrize("ratio", [2, 3])
@pytest.mark.parametrize("faster", [True, False])
def test_another_step_is_believed_at_once_where_time_says_so(faster: bool, ratio: int) -> None:
    """Twice as fast, all nodes come in the time that they take; with each second one lost, in twice of that."""
    rotation, now = NodeSteps(TURN), 10**9
    rotation.tell_time(31_250.0)

    def told(step: int, packets_ns: int) -> int:
        nonlocal now
        arrivals = []
        for end in range(28, 141, 28):
            now += 28 * packets_ns
            arrivals.append((end, now))
        return lost(rotation.follow(nodes_of(step), arrivals))

    assert [told(7, 31_250) for _ in range(4)] == [0] * 4
    # It is confirmed now: a gap takes nothing back.
    arcs = rotation.copy().follow(steps_of(*[7] * 50, 14, *[7] * 50))
    assert (lost(arcs), arcs.revoked) == (1, (0, 0))
    again = [told(7 * ratio, 31_250 if faster else 31_250 * ratio) for _ in range(6)]
    assert again == [0 if faster else 140 * (ratio - 1)] * 6


@pytest.mark.parametrize("count", range(4, 9))
def test_six_steps_that_agree_are_sure(count: int) -> None:
    assert NodeSteps(TURN).follow(nodes_of(7, count)).certain == (count >= 6)
    assert not NodeSteps(TURN).follow(nodes_of(0, count)).certain


def test_a_quarter_of_the_first_nodes_may_be_doubled() -> None:
    arcs = NodeSteps(TURN).follow(steps_of(*[7, 7, 7, 0] * 8))
    assert (arcs.certain, lost(arcs)) == (True, 0)


def test_one_node_alone_tells_no_step() -> None:
    arcs = NodeSteps(TURN).follow(heads(headings(100), None))
    assert (arcs.certain, arcs.step, lost(arcs)) == (False, 0, 0)


def test_the_first_steps_of_a_rotor_that_stood_are_its_speed() -> None:
    rotation = knowing(0)
    arcs = rotation.follow(steps_of(*[7] * 50, 14, *[7] * 50))
    assert (arcs.certain, lost(arcs)) == (True, 1)


@pytest.mark.parametrize("ahead", [25, 515, 525, 1900])
@pytest.mark.parametrize("before", [1, 3, 60])
def test_what_leaps_ahead_and_falls_back_within_40_nodes_is_no_gap(before: int, ahead: int) -> None:
    for false in (1, 2, 20, 39, 40):
        rotation, angles = knowing(7), 7 * np.arange(150)
        angles[before : before + false] += ahead
        # How many nodes a leap is, is rounded.
        assert lost(rotation.follow(heads(headings(*angles.tolist()), 1050))) <= 1, false
        # Farther apart, both are believed, unless a correction by the distance, up to 8 degrees, explains both.
        angles[before : before + 41] = 7 * np.arange(before, before + 41) + ahead
        gap = ahead / 7 if ahead > 519 else 0
        assert lost(rotation.follow(heads(headings(*angles.tolist()), 1050))) == pytest.approx(gap, abs=1)


EDGES = [(10, 90, 70), (120, 130, 120), (200, 270, 250)]
"""Where targets are near, and how far back nodes lie there."""


@pytest.mark.parametrize(
    ("edges", "gap"), [*((EDGES, gap) for gap in (0, 1, 5)), *(([(10, 90, off)], 0) for off in (65, 70, 120, 250))]
)
def test_angles_that_are_corrected_by_the_distance_hide_no_gap_and_are_none(
    edges: list[tuple[int, int, int]], gap: int
) -> None:
    """Where an edge is near, nodes fall back behind it, and leap ahead behind the next one: by up to some steps."""
    rotation, angles = knowing(80), 80 * np.arange(288)
    for begin, end, off in edges:
        angles[begin:end] -= off
    left = np.delete(angles, range(150, 150 + gap)) % TURN
    arcs = rotation.follow(heads(headings(*left.tolist()), 0))
    assert lost(arcs) == gap
    # Of gaps and leaps that are alike nobody knows which is which.
    assert gap < 5 or missing(arcs)[149] == gap
