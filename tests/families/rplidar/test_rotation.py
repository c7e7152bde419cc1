"""How far the rotor turned in each packet, and what is missing between two."""

import sys

import numpy as np
import pytest

from lidario.families.rplidar.node_steps import NodeSteps
from lidario.families.spans import Heads
from tests.support.wheels import TURN, heads, lost, turning


def steps_of(*steps: int) -> Heads:
    """Nodes so far apart, and one behind them."""
    return heads(*turning(*steps))


def nodes_of(step: int, count: int = 140) -> Heads:
    """Nodes that far apart."""
    return steps_of(*[step] * count)


def knowing(step: int) -> NodeSteps:
    """A model that has followed nodes so far apart."""
    rotation = NodeSteps(TURN)
    rotation.follow(nodes_of(step))
    return rotation


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
    arcs = NodeSteps(TURN).follow(heads([100], None))
    assert (arcs.certain, arcs.step, lost(arcs)) == (False, 0, 0)


@pytest.mark.parametrize("ahead", [25, 515, 525, 1900])
@pytest.mark.parametrize("before", [1, 3, 60])
def test_what_leaps_ahead_and_falls_back_within_40_nodes_is_no_gap(before: int, ahead: int) -> None:
    for false in (1, 2, 20, 39, 40):
        rotation, angles = knowing(7), 7 * np.arange(150)
        angles[before : before + false] += ahead
        # How many nodes a leap is, is rounded.
        assert lost(rotation.follow(heads(angles % TURN, 1050))) <= 1, false
        # Farther apart, both are believed, unless a correction by the distance, up to 8 degrees, explains both.
        angles[before : before + 41] = 7 * np.arange(before, before + 41) + ahead
        gap = ahead / 7 if ahead > 519 else 0
        assert lost(rotation.follow(heads(angles % TURN, 1050))) == pytest.approx(gap, abs=1)
