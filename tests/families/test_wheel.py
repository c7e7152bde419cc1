"""A clock and a wheel: streams of which all angles and times are known, and what the model tells of them.

Where a rotor stands for a while, the revolution in which it stood has more packets, and none is missing.
"""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from lidario.families.pace import Pace
from lidario.families.rplidar.node_steps import NodeSteps
from lidario.families.spans import Arcs, Turning
from lidario.families.wheel import Wheel
from tests.support.wheels import TURN, heads, lost, missing, turning

PACKET_NS = 2_000_000


def knowing_500() -> Wheel:
    """A wheel that has followed spans of 500."""
    wheel = Wheel(TURN)
    wheel.follow(heads(*turning(*[500] * 20)))
    return wheel


def even(hertz: float, packets: int) -> NDArray[np.floating]:
    """Where an even rotor is at the beginning of each packet, in turns."""
    return 0.3 + hertz * PACKET_NS * 1e-9 * np.arange(packets)


def told(turns: NDArray[np.floating], kept: Iterable[int]) -> list[tuple[list[int], Arcs]]:
    """What a wheel tells of those packets that come, turn by turn: their numbers, and what it says.

    Args:
        turns: Where the rotor is at each packet of the stream.
        kept: Those that come; one more than are told of.
    """
    wheel, found = Wheel(TURN), list[tuple[list[int], Arcs]]()
    wheel.tell_time(PACKET_NS)
    numbers = sorted(kept)
    angles = np.floor(turns % 1.0 * TURN).astype(np.int32)
    whole = np.floor(turns).astype(int)
    for turn in range(int(whole[numbers[-1]])):
        here = [number for number in numbers[:-1] if whole[number] == turn]
        if not here:
            continue
        behind = next(number for number in numbers if number > here[-1])
        ends = [*range(5, len(here), 5), len(here)]
        arrivals = [(end, (here[end - 1] + 1) * PACKET_NS) for end in ends]
        found.append((here, wheel.follow(heads(angles[here], int(angles[behind])), arrivals)))
    return found


@pytest.mark.parametrize("spans", range(4, 9))
def test_six_spans_that_agree_are_sure_without_times(spans: int) -> None:
    """The last packet tells a span only where one is behind it."""
    wheel = Wheel(TURN)
    arcs = [wheel.follow(heads(*turning(*[500] * spans))) for _ in range(2)]
    assert arcs[0].certain == (spans >= 6)
    assert not any(arcs[1].revoked)
    first, _ = turning(*[500] * (spans + 1))
    assert Wheel(TURN).follow(heads(first, None)).certain == (spans >= 6)


@pytest.mark.parametrize("every", [2, 3])
@pytest.mark.parametrize("hertz", [10.0, 20.0, 50.0])
def test_what_was_told_before_a_speed_was_sure_is_revoked_once(hertz: float, every: int) -> None:
    """The fewer packets a turn has, the more turns pass before time tells."""
    found = told(even(hertz, 500), range(0, 500, every))
    missing_before = sum(each * packets for each, packets in (arcs.revoked for _, arcs in found))
    right = [lost(arcs) == (every - 1) * len(here) for here, arcs in found]
    first = right.index(True)
    assert missing_before == (every - 1) * sum(len(here) for here, _ in found[:first])
    assert all(right[first:])
    assert not any(any(arcs.revoked) for _, arcs in found[first + 1 :])


@pytest.mark.parametrize("gone", range(1, 11))
def test_the_arc_before_a_gap_lies_between_the_one_before_and_those_in_the_gap(gone: int) -> None:
    arcs = knowing_500().follow(heads(*turning(500, 510 * (1 + gone), 1040, 515)))
    assert missing(arcs) == [0, gone, 1, 0]
    # At the middles of what they are means of. A gap that is too long tells nothing.
    first, mean = (np.interp(0.5, [-0.5, (1 + gone) / 2], [500, 510]), 510) if gone <= 8 else (500, 500)
    second = np.interp(0.5, [-0.5, 1], [mean, 520])
    assert np.asarray(arcs.arc).tolist() == pytest.approx([500, first, second, 515])


@pytest.mark.parametrize(("next_span", "gone"), [(800, 0), (735, 0), (864, 0), (704, 1), (896, 1)])
def test_a_span_of_no_whole_number_is_another_speed_where_the_next_one_is_like_it(
    next_span: int, gone: int
) -> None:
    """Within a tenth of it."""
    assert missing(knowing_500().follow(heads(*turning(800, next_span))))[0] == gone


@pytest.mark.parametrize("span", [300, 374, 626, 740])
def test_a_span_that_is_no_arc_and_stands_alone_hides_a_whole_turn(span: int) -> None:
    """Or a false packet. It is no speed that the next spans are held against."""
    arcs = knowing_500().follow(heads(*turning(500, span, 1000, 500, 500)))
    assert np.asarray(arcs.arc).tolist() == [500] * 5
    assert missing(arcs) == [0, 0, 1, 0, 0]


@pytest.mark.parametrize("times", [9.4, 9.6, 17.4])
def test_spans_of_many_arcs_that_agree_are_no_speed(times: float) -> None:
    """Where a false packet lies between two gaps, they may be alike by chance."""
    arcs = knowing_500().follow(heads(*turning(500, round(500 * times), round(500 * times) + 50, 500)))
    is_speed = times < 9.5
    assert (lost(arcs) == 0) is is_speed
    assert (max(arcs.arc) < 520) is not is_speed


@pytest.mark.parametrize("before", [0, 3])
def test_the_fourth_span_in_a_row_that_fits_nothing_is_another_speed(before: int) -> None:
    """One that is shorter than an arc, and not like the next, hides a whole turn."""
    wheel = knowing_500()
    for at in range(before):
        wheel.follow(heads(*turning(280 + at)))
    if before:
        wheel.follow(heads(*turning(500, 1000, 500)))
    arcs = [float(wheel.follow(heads(*turning(280 + at))).arc[0]) for at in range(6)]
    assert arcs == [500, 500, 500, 283, 284, 285]


@pytest.mark.parametrize("every", [3, 4, 5, 6])
def test_a_device_slower_than_it_says_has_lost_what_lies_between_its_packets_or_as_many_again(every: int) -> None:
    """By time, its arcs are half as long. But then, of many gaps, some would be of one and a half of them."""
    kept = [2 * at for at in range(700) if at % every or at < 4]
    behind = dict(pairwise(kept))
    for here, arcs in told(even(4.0, 1400), kept):
        between = sum((behind[at] - at) // 2 - 1 for at in here)
        assert arcs.certain
        assert lost(arcs) == (between if every <= 4 else 2 * between + len(here))


@pytest.mark.parametrize("spans", [2, 3, 4])
def test_three_spans_that_agree_are_sure_where_time_says_how_many_arcs_they_are(spans: int) -> None:
    wheel = Wheel(TURN)
    wheel.tell_time(PACKET_NS)
    arrivals = [(at + 1, (9 * at + 1) * PACKET_NS) for at in range(spans)]
    arcs = wheel.follow(heads(*turning(*[9 * 460] * spans)), arrivals)
    assert (arcs.certain, missing(arcs)) == (spans >= 3, [8 * (spans >= 3)] * spans)


@pytest.mark.parametrize("lost_before", [False, True])
@pytest.mark.parametrize("times", [1, 2])
def test_a_speed_that_leaps_is_no_loss_where_time_speaks_against_it(times: int, lost_before: bool) -> None:
    """Twice as fast from one revolution to the next, or each second packet lost: by when they come."""
    wheel, now = Wheel(TURN), 48
    wheel.tell_time(PACKET_NS)
    wheel.follow(heads(*turning(*[480] * 48)), [(at, at * PACKET_NS) for at in range(1, 49)])
    if lost_before:
        # When these came tells nothing behind a whole revolution.
        arrivals = [(3, (now + 3) * PACKET_NS), (7, (now + 7) * PACKET_NS), (11, (now + 12) * PACKET_NS)]
        assert lost(wheel.follow(heads(*turning(*[480] * 10, 960)), arrivals)) == 1
        now += 60
        assert wheel.follow_several(heads(*turning(*[480] * 48)), [48], [(48, now * PACKET_NS)]) is not None
    for turn in range(4):
        arrivals = [(at, (now + times * (24 * turn + at)) * PACKET_NS) for at in range(1, 25)]
        arcs = wheel.follow(heads(*turning(*[960] * 24)), arrivals)
        assert (arcs.certain, lost(arcs)) == (True, 24 * (times - 1))


@pytest.mark.parametrize("speeds", [(500,), (590,), (500, 590), (500, 590, 700), (420, 500)])
def test_revolutions_are_steady_where_each_goes_on_as_the_one_before_ended(speeds: tuple[int, ...]) -> None:
    wheel, arrivals = Wheel(TURN), [(20 * len(speeds), 1000)]
    spans = [speed for speed in speeds for _ in range(20)]
    ends = range(20, len(spans) + 1, 20)
    assert wheel.follow_several(heads(*turning(*spans)), ends, arrivals) is None
    wheel.follow(heads(*turning(*[500] * 20)))
    before = (500, *speeds)[-2]
    for odd in (before * 5 // 4, before * 3 // 4):
        assert wheel.follow_several(heads(*turning(*spans[:-1], odd)), ends, arrivals) is None
    # Several reads may yet tell that an arc is of two packets.
    assert wheel.follow_several(heads(*turning(*spans)), ends, [(5, 900), *arrivals]) is None
    # Where there are none, nothing is remembered.
    assert lost(wheel.copy().follow(heads(*turning(1500)))) == 2
    arcs = wheel.follow_several(heads(*turning(*spans)), ends, arrivals)
    assert arcs is not None
    assert (arcs.steps, np.asarray(arcs.arc).tolist()) == (list(speeds), spans)
    assert lost(wheel.follow(heads(*turning(3 * speeds[-1])))) == 2


@pytest.mark.parametrize(
    ("turn", "spans", "step"),
    [
        (Wheel(TURN), [500, 500, 500, 250, 0, 0, 250, 500, 500, 500], 350),
        # In one in which it did nothing else, nothing tells how many there are.
        (Wheel(TURN), [0, 0, 0], 500),
        (NodeSteps(TURN), [500] * 64 + [0] * 128 + [500] * 64, 250),
        (NodeSteps(TURN), [0] * 2000, 500),
    ],
)
def test_a_revolution_in_which_it_stood_has_more_of_them(turn: Turning, spans: list[int], step: float) -> None:
    turn.follow(heads(*turning(*[500] * 140)))
    arcs = turn.follow(heads(*turning(*spans)))
    assert (list(arcs.arc), lost(arcs), arcs.certain) == (spans, 0, True)
    assert arcs.step == pytest.approx(step)
    assert lost(turn.follow(heads(*turning(*[500] * 140)))) == 0


@pytest.mark.parametrize("slow", [16, 20, 24])
def test_a_node_that_is_lost_where_the_rotor_is_slow_is_missed_though_it_was_fast(slow: int) -> None:
    """From that node to the next but one it turns by less than it did from one node to the next."""
    before = [*[100] * 64, *(200 - at >> 1 for at in range(200 - 2 * slow)), *[slow] * 40]
    turn = NodeSteps(TURN)
    turn.follow(heads(*turning(*[100] * 140)))
    gone = missing(turn.follow(heads(*turning(*before, 2 * slow, *[slow] * 24))))
    assert gone == [0] * len(before) + [1] + [0] * 24


@pytest.mark.parametrize("pieces", [1, 2, 3])
def test_in_a_file_six_spans_that_agree_are_one_arc_each_unless_bytes_were_skipped_between(pieces: int) -> None:
    """The rotor turns twice as fast; or each second packet is lost, and what it was is between the pieces."""
    wheel = Wheel(TURN)
    wheel.tell_time(PACKET_NS, passes=False)
    wheel.follow(heads(*turning(*[480] * 40)), [(40, 40 * PACKET_NS)])
    arrivals = [(6 * piece // pieces, (40 + piece) * PACKET_NS) for piece in range(1, pieces + 1)]
    assert lost(wheel.follow(heads(*turning(*[960] * 6)), arrivals)) == (0 if pieces == 1 else 6)


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


def test_packets_in_which_it_stood_are_not_missing_once_a_speed_is_sure() -> None:
    """They follow each other at any speed; the outage in which it began to turn is one gap."""
    seconds = np.arange(1500) * PACKET_NS * 1e-9
    turns = 0.3 + np.cumsum(np.where(seconds > 1.0, 10.0, 0.0)) * PACKET_NS * 1e-9
    found = told(turns, [*range(450), *range(535, 1500)])
    told_lost = sum(lost(arcs) + arcs.revoked[0] * arcs.revoked[1] for _, arcs in found)
    assert told_lost <= 85


def test_one_that_stands_and_trembles_back_a_little_is_followed_when_it_turns() -> None:
    """Its last span is below 0, and no rotor turns back."""
    wheel = knowing_500()
    wheel.follow(heads(*turning(*range(500, 0, -20), 0)))
    wheel.follow(heads(*turning(*[0] * 40, -1)))
    assert lost(wheel.follow(heads(*turning(*[500] * 20)))) == 0


@pytest.mark.parametrize("spans", [[0] * 12 + [960] * 24, [960] * 24 + [0] * 12, [960] * 24])
def test_time_tells_that_an_arc_is_too_short_also_where_the_rotor_stood_in_one_half_of_it(spans: list[int]) -> None:
    """No packet is missing, and the rotor turned by more than twice as many arcs as the device had time for."""
    pace = Pace(TURN)
    for number, span in enumerate(spans):
        pace.add([span], [(1, number * PACKET_NS)])
    assert pace.is_too_short(PACKET_NS, 240.0)
    assert not pace.is_too_short(PACKET_NS, 960.0)
