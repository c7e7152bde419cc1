"""Where a turn ends: at 0 or where the device says, once a turn, whatever trembles, is lost, or begins anew."""

from collections.abc import Callable

import numpy as np
import pytest

from lidario.revolution.seam import Seam, Split
from lidario.wire.formats import BEGINS, RESTARTS, Headings

TURN = 36_000
"""Hundredths of degrees, to be read by eye."""


@pytest.mark.parametrize(
    ("headings", "found"),
    [
        # Most of them near the seam, or most of them beyond it.
        ([1_000, 2_000, 3_000, 4_000, 20_000, 35_900, 10], [6]),
        ([1_000, 2_000, 3_000, 4_000, 32_000, 35_900, 10], [6]),
        ([10, 20, 30, 40, 50, 35_900, 60], []),  # trembled back over the seam
        ([10, 20, 30, 40, 50, 35_900, 35_950, 60], []),
        ([10, 20, 35_800, 35_850, 35_900, 35_950, 60], []),
        ([10, 12_000, 35_800, 35_850, 35_900, 35_950, 60], [6]),
        ([10, 8_000, 32_950, 35_850, 35_900, 35_950, 60], [6]),
    ],
)
def test_few_readings_far_from_the_seam(headings: list[int], found: list[int]) -> None:
    """Together, and one by one."""
    together, array, single = Seam(TURN, 0), Seam(TURN, 0), Seam(TURN, 0)
    assert [split.packet for split in together.splits(headings)] == found
    assert [split.packet for split in array.splits(np.array(headings))] == found
    assert [number for number, heading in enumerate(headings) if single.splits([heading])] == found


def test_without_a_seam_only_marks_count() -> None:
    assert Seam(TURN, None).splits([30_000, 2_000, 20_000, 30_000, 2_000]) == []
    seam = Seam(TURN, None)
    assert seam.splits([30_000, 10 | BEGINS, 20_000]) == [Split(1, marked=True, broken=False, seam=10)]
    assert seam.angle == 10
    # From now on the angle tells too, should a mark be lost.
    assert seam.splits([30_000, 100, 20_000]) == [Split(1, marked=False, broken=False, seam=10)]


@pytest.mark.parametrize("many", [tuple, np.array])
def test_after_two_turns_without_a_mark_none_is_waited_for(many: Callable[[list[int]], Headings]) -> None:
    turn = [1_000, 9_000, 18_000, 27_000, 35_000]
    seam = Seam(TURN, None)
    assert seam.splits(many(turn * 2)) == []
    assert seam.angle is None
    assert seam.splits(many(turn * 3)) == [Split(at, marked=False, broken=False, seam=0) for at in (5, 10)]
    assert seam.angle == 0


@pytest.mark.parametrize("many", [tuple, np.array])
def test_trembling_where_no_mark_is_waited_for_any_more_ends_no_turn(many: Callable[[list[int]], Headings]) -> None:
    turn = [1_000, 9_000, 18_000, 27_000, 35_000]
    headings = [*turn, *turn, 500, 35_800, *turn, 1_000]
    assert Seam(TURN, None).splits(many(headings)) == [Split(17, marked=False, broken=False, seam=0)]


STEADY = [20_000 + 1_000 * number for number in range(8)]
UNEVEN = [0, 1_000, 2_000, 4_000, 6_000, 8_000, 11_000, 14_000]
"""Of its steps the middle one is the steady one."""


@pytest.mark.parametrize(
    ("before", "restart", "is_one"),
    [
        *((STEADY, restart, False) for restart in (1_000, 1_200, 2_000, 5_000, 7_800, 8_100)),
        *((STEADY, restart, True) for restart in (0, 200, 1_500, 5_500, 9_000, 10_000, 20_000, TURN - 1_000)),
        *((UNEVEN, 1_000, True), (UNEVEN, 2_000, False), (UNEVEN, 3_000, True)),
        # Where no step is known.
        *(([], 20_000, True), ([20_000], 1_000, True)),
    ],
)
def test_a_restart_is_one_unless_it_fits_the_steady_step(before: list[int], restart: int, is_one: bool) -> None:
    """Headings, and then one that says that the stream was restarted, so far behind the last of them."""
    found = Seam(TURN, 0).splits([*before, (sum(before[-1:]) + restart) % TURN | RESTARTS])
    assert found == [Split(len(before), marked=False, broken=True, seam=0)] * is_one


def marked(*headings: int) -> list[tuple[int, bool]]:
    found = Seam(TURN, None).splits(headings)
    return [(split.packet, split.marked) for split in found]


@pytest.mark.parametrize("late", [10, 500, 3_000])
def test_a_mark_just_behind_the_seam_begins_no_second_turn(late: int) -> None:
    """The first turn's mark stood at 0; the next stands a little behind it, and a packet slips before it."""
    found = marked(0 | BEGINS, 9_000, 18_000, 27_000, late // 2, late | BEGINS, 9_000, 18_000, 27_000, 35_000, late)
    assert found[0] == (0, True)
    assert found[1] == (4, False)
    assert len(found) == 3


def test_a_mark_before_the_seam_ends_the_turn_once() -> None:
    found = marked(0 | BEGINS, 9_000, 18_000, 27_000, 35_000 | BEGINS, 10, 9_000, 18_000, 27_000, 34_900, 35_100)
    assert found == [(0, True), (4, True), (10, False)]


@pytest.mark.parametrize(("place", "moved"), [(3_000, False), (3_001, True), (33_000, True), (33_001, False)])
def test_a_mark_that_stands_elsewhere_than_the_one_before_has_moved(place: int, moved: bool) -> None:
    """By more than a twelfth of a turn, either way: what lies before it is only part of a turn."""
    seam = Seam(TURN, None)
    seam.splits([0 | BEGINS, *range(500, place, 500)])
    assert seam.splits([place | BEGINS]) == [Split(0, marked=True, broken=False, seam=place, moved=moved)]
