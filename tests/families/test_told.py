"""Packets that tell their own way: what is missing between them, and the speed that they tell."""

import numpy as np
import pytest

from lidario.families.told import ToldWheel
from tests.support.wheels import TURN, heads, lost


@pytest.mark.parametrize(("back_deg", "known"), [(0.0, True), (1.9, True), (2.1, False)])
def test_a_packet_may_begin_two_degrees_before_the_end_of_the_one_before(back_deg: float, known: bool) -> None:
    """Farther back it is the long way round, and the rest of a revolution is missing."""
    begins = [1000, 1950 - round(64 * back_deg), 2910]
    arcs = ToldWheel(TURN, 48).follow(heads(begins, 3870, 96, np.full(3, 950)))
    assert (lost(arcs) == 0) == known
    if not known:
        assert lost(arcs) == pytest.approx((TURN - 64 * back_deg) / 10, rel=0.01)


@pytest.mark.parametrize("last", [950, 1060])
@pytest.mark.parametrize("followed", [True, False])
def test_the_mean_step_counts_what_lies_between_packets_where_that_is_known(followed: bool, last: int) -> None:
    ways = np.array([950] * 11 + [last])
    begins = np.cumsum([0, *(ways + 12)])
    arcs = ToldWheel(TURN, 48).follow(heads(begins[:-1], int(begins[-1]) if followed else None, 96, ways))
    assert arcs.step == pytest.approx(begins[-1] / (12 * 96) if followed else ways.sum() / (12 * 95))


def test_packets_that_tell_no_way_tell_no_speed() -> None:
    arcs = ToldWheel(TURN, 48).follow(heads([5, 5, 5], 5, 96, np.zeros(3)))
    assert (arcs.certain, arcs.step, lost(arcs)) == (False, 0, 0)


def test_packets_of_which_only_a_damaged_one_tells_a_way_tell_no_speed() -> None:
    """A packet of one sample has none."""
    packets = heads([0, 0], 5000, 2, np.array([500, 0]))._replace(counts=np.array([1, 2]))
    arcs = ToldWheel(TURN, 2).follow(packets)
    assert (arcs.certain, arcs.skipped, arcs.step) == (False, None, 0.0)
