"""A rotor that creeps, and was or is fast in the same revolution: what is missing there, and how far it turned."""

import numpy as np
import pytest

from lidario.families.wheel import Wheel
from tests.families.test_wheel import PACKET_NS, told
from tests.support.wheels import TURN, heads, lost, missing, turning


def test_packets_that_are_lost_of_a_rotor_that_creeps_show_no_other_speed() -> None:
    """Each of its arcs is far from the fastest one, and is one arc for all that."""
    wheel = Wheel(TURN, 40)
    assert wheel.follow(heads(*turning(*[856] * 26))).certain
    spans = [*range(846, 40, -26), *[28] * 75, 5 * 28, *[28] * 150, *range(31, 200, 8), 3 * 210]
    found = wheel.follow(heads(*turning(*spans)))
    assert [(at, each) for at, each in enumerate(missing(found)) if each] == [(len(spans) - 1, 2 * 40)]
    off = np.abs(np.asarray(found.arc) - [*spans[:-1], 210])
    # The packet before the gap of five arcs is not stretched over it.
    assert sorted(off)[:-1] == pytest.approx([0] * (len(spans) - 1), abs=10)
    assert off.max() <= 4 * 28


@pytest.mark.parametrize("creeps", [3, 12])
def test_behind_one_that_all_but_stood_no_more_is_missing_than_there_was_time_for(creeps: int) -> None:
    """It went on while nothing came. By how it crept before, thousands of packets would be missing."""
    wheel, gone = Wheel(TURN), 200
    wheel.tell_time(PACKET_NS)
    spans = [*[1000] * 8, *range(900, creeps, -100), *[creeps] * 9, TURN // 2, *[1000] * 8]
    behind = spans.index(TURN // 2)
    ends = [(number + 1, (number + 1 + gone * (number > behind)) * PACKET_NS) for number in range(len(spans))]
    assert wheel.follow(heads(*turning(*[1000] * 23)), [(23, 0)]).certain
    found = wheel.follow(heads(*turning(*spans)), ends)
    assert missing(found)[behind] == pytest.approx(gone, abs=2)
    assert lost(found) == missing(found)[behind]


def reads(packets: int) -> list[tuple[int, int]]:
    """Arrivals of packets of which none is missing, some at a time."""
    return [(end, end * PACKET_NS) for end in [*range(7, packets, 7), packets]]


def test_one_packet_that_is_lost_while_a_rotor_starts_again_is_one() -> None:
    """It stood for half of the time, and turned by no arc: only all of the time tells that these are not short."""
    wheel = Wheel(TURN, 40)
    wheel.tell_time(PACKET_NS / 40)
    assert wheel.follow(heads(*turning(*[163] * 140)), reads(140)).certain
    starts = range(4, 1260, 35)
    spans = [111, 62, 13, *[0] * 22, *starts[:8], starts[8] + starts[9], *starts[10:]]
    found = wheel.follow(heads(*turning(*spans)), reads(len(spans)))
    assert [(at, each) for at, each in enumerate(missing(found)) if each] == [(33, 40)]


def test_packets_in_which_it_stood_are_not_missing_once_a_speed_is_sure() -> None:
    """They follow each other at any speed; the outage in which it began to turn is one gap."""
    seconds = np.arange(1500) * PACKET_NS * 1e-9
    turns = 0.3 + np.cumsum(np.where(seconds > 1.0, 10.0, 0.0)) * PACKET_NS * 1e-9
    found = told(turns, [*range(450), *range(535, 1500)])
    told_lost = sum(lost(arcs) + arcs.revoked[0] * arcs.revoked[1] for _, arcs in found)
    assert told_lost <= 85
