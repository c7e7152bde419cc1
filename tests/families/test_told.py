"""Packets that tell their own way: what is missing between them, and which of their angles are damaged."""

import numpy as np
import pytest
from numpy.typing import NDArray

from lidario.families.spans import Heads
from lidario.families.told import ToldWheel
from tests.support.wheels import heads, lost, missing

TURN = 23040


def headings(*angles: int) -> NDArray[np.int32]:
    return np.array([angle % TURN for angle in angles], np.int32)


@pytest.mark.parametrize(("back_deg", "known"), [(0.0, True), (1.9, True), (2.1, False)])
def test_a_packet_may_begin_two_degrees_before_the_end_of_the_one_before(back_deg: float, known: bool) -> None:
    """Farther back it is the long way round, and the rest of a revolution is missing."""
    begins = headings(1000, 1950 - round(64 * back_deg), 2910)
    arcs = ToldWheel(TURN, 48).follow(heads(begins, 3870, 96, np.full(3, 950)))
    assert (lost(arcs) == 0) == known
    if not known:
        assert lost(arcs) == pytest.approx((TURN - 64 * back_deg) / 10, rel=0.01)


def test_a_packet_that_tells_twice_the_usual_way_is_damaged_beside_a_gap_too() -> None:
    ways = np.array([2375, 950, 950])  # and 950 is what one turns
    arcs = ToldWheel(TURN, 48).follow(heads(headings(1000, 2920, 3880), 4840, 96, ways))
    assert missing(arcs) == [96, 0, 0]


def test_a_packet_that_is_lost_where_the_rotor_is_slow_is_missed_though_it_is_fast_elsewhere() -> None:
    """From one of the slow packets to the next but one it turns by less than during one of the fast."""
    steps, left = np.repeat([10, 3], 10), np.delete(np.arange(20), 15)
    begins = np.cumsum(96 * steps) - 96 * steps
    arcs = ToldWheel(TURN, 48).follow(heads(begins[left], 96 * steps.sum(), 96, 95 * steps[left]))
    assert missing(arcs) == [96 * (at == 14) for at in range(19)]


def packets_of(ways: list[int], jumps: list[int]) -> Heads:
    """Packets of 96 samples that tell their ways, and how far behind the end of each the next one begins."""
    begins = np.cumsum([0, *(way + jump for way, jump in zip(ways, jumps, strict=True))])
    return heads(begins[:-1], int(begins[-1]), 96, np.array(ways))


@pytest.mark.parametrize("way", [0, 6, 20])
def test_what_is_lost_behind_a_short_packet_is_counted_by_the_long_ones_beside_it(way: int) -> None:
    packets = packets_of([285] * 8 + [way] + [950] * 8, [3] * 8 + [970] + [10] * 8)
    arcs = ToldWheel(TURN, 48).follow(packets._replace(counts=np.array([96] * 8 + [3] + [96] * 8)))
    assert missing(arcs) == [96 * (at == 8) for at in range(17)]


@pytest.mark.parametrize(("jump", "gone"), [(16, 0), (17, 1)])
def test_a_jump_may_be_one_unit_longer_than_a_step_and_what_may_lack(jump: int, gone: int) -> None:
    """The angles at both of its ends are rounded."""
    arcs = ToldWheel(TURN, 0.5).follow(packets_of([950] * 4, [10, 10, jump, 10]))
    assert lost(arcs) == gone


@pytest.mark.parametrize("which", ["first", "last"])
@pytest.mark.parametrize("at", [1, 5, 10])
def test_a_packet_of_which_an_angle_is_damaged_hides_none(at: int, which: str) -> None:
    """The other one tells where it stood. What is lost elsewhere is missed all the same."""
    ways, jumps = [950] * 12, [10] * 12
    jumps[7] = 970
    ways[at] = 350
    jumps[at - 1 if which == "first" else at] += 600
    arcs = ToldWheel(TURN, 48).follow(packets_of(ways, jumps))
    assert missing(arcs) == [96 * (each == 7) for each in range(12)]


@pytest.mark.parametrize("at", [0, 1])
def test_of_two_packets_the_sound_one_tells_the_step_of_the_other(at: int) -> None:
    ways, jumps = [950, 950], [10, 10]
    ways[at], jumps[at] = 350, 610
    assert lost(ToldWheel(TURN, 48).follow(packets_of(ways, jumps))) == 0


def test_what_is_lost_while_the_rotor_stood_passed_as_fast_as_it_turns() -> None:
    arcs = ToldWheel(TURN, 48).follow(packets_of([950, 950, 0, 0, 0, 950, 950], [10, 10, 0, 970, 0, 10, 10]))
    assert missing(arcs) == [96 * (at == 3) for at in range(7)]


@pytest.mark.parametrize("second", [5, 10, 20])
@pytest.mark.parametrize("end", [5, 12])
@pytest.mark.parametrize("counts", [96, np.full(24, 96, np.int32)])
def test_several_revolutions_that_tell_their_own_have_a_step_each(
    second: int, end: int, counts: int | NDArray[np.int32]
) -> None:
    """Of few packets of any size, the longest one may be short."""
    steps = [10] * end + [second] * (24 - end)
    packets = packets_of([95 * step for step in steps], steps)._replace(counts=counts)
    arcs = ToldWheel(TURN, 48).follow_several(packets, [end, 24])
    assert (arcs is None) == (end < 6 and not isinstance(counts, int))
    assert arcs is None or [lost(arcs), *arcs.steps] == pytest.approx([0, 10, second])


@pytest.mark.parametrize(("way", "jump"), [(0, 10), (1060, 10), (950, 970), (950, 500)])
def test_one_that_is_odd_among_several_revolutions_has_each_judged_alone(way: int, jump: int) -> None:
    """Or where the rotor stands all the time."""
    for at in (0, 11, 12, 23):
        ways, jumps = [950] * 24, [10] * 24
        ways[at], jumps[at] = way, jump
        if not way:
            ways = [0 if at // 12 == each // 12 else 950 for each in range(24)]
        assert ToldWheel(TURN, 48).follow_several(packets_of(ways, jumps), [12, 24]) is None


@pytest.mark.parametrize("last", [950, 1060])
@pytest.mark.parametrize("followed", [True, False])
def test_the_mean_step_counts_what_lies_between_packets_where_that_is_known(followed: bool, last: int) -> None:
    ways, jumps = [950] * 11 + [last], [12] * 12
    packets = packets_of(ways, jumps)
    arcs = ToldWheel(TURN, 48).follow(packets if followed else packets._replace(following=None))
    assert arcs.step == pytest.approx((sum(ways) + sum(jumps)) / (12 * 96) if followed else sum(ways) / (12 * 95))


def test_packets_that_tell_no_way_tell_no_speed() -> None:
    arcs = ToldWheel(TURN, 48).follow(heads(headings(5, 5, 5), 5, 96, np.zeros(3)))
    assert (arcs.certain, arcs.step, lost(arcs)) == (False, 0, 0)


def test_packets_of_which_only_a_damaged_one_tells_a_way_tell_no_speed() -> None:
    """A packet of one sample has none."""
    arcs = ToldWheel(TURN, 2).follow(
        heads(headings(0, 0), 5000, 2, np.array([500, 0]))._replace(counts=np.array([1, 2]))
    )
    assert (arcs.certain, arcs.skipped, arcs.step) == (False, None, 0.0)
