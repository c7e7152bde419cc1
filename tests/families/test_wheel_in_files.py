"""A clock and a wheel, in a file of bytes: no time passes there while packets are missing."""

import numpy as np
import pytest

from lidario.families.wheel import Wheel
from tests.support.wheels import TURN, heads, lost, missing, turning

PACKET_NS = 2_000_000


@pytest.mark.parametrize("pieces", [1, 2, 3])
def test_in_a_file_six_spans_that_agree_are_one_arc_each_unless_bytes_were_skipped_between(pieces: int) -> None:
    """The rotor turns twice as fast; or each second packet is lost, and what it was is between the pieces."""
    wheel = Wheel(TURN)
    wheel.tell_time(PACKET_NS, passes=False)
    wheel.follow(heads(*turning(*[480] * 40)), [(40, 40 * PACKET_NS)])
    arrivals = [(6 * piece // pieces, (40 + piece) * PACKET_NS) for piece in range(1, pieces + 1)]
    assert lost(wheel.follow(heads(*turning(*[960] * 6)), arrivals)) == (0 if pieces == 1 else 6)


@pytest.mark.parametrize(
    ("behind", "is_one"), [([960] * 6, True), ([960] * 5, False), ([960] * 3 + [480] * 6, False)]
)
def test_in_a_file_six_spans_that_agree_behind_an_outage_are_one_arc_each(behind: list[int], is_one: bool) -> None:
    """The rotor turns twice as fast, also where it was slower in the same revolution; fewer may be gaps."""
    wheel = Wheel(TURN)
    wheel.tell_time(PACKET_NS, passes=False)
    wheel.follow(heads(*turning(*[480] * 40)), [(40, 40 * PACKET_NS)])
    arcs = wheel.follow(heads(*turning(*[480] * 10, 480 * 12, *behind)), [(11 + len(behind), 90 * PACKET_NS)])
    assert arcs.certain
    assert missing(arcs)[:11] == [0] * 10 + [11]
    assert missing(arcs)[11:] == [0 if is_one or span == 480 else 1 for span in behind]


@pytest.mark.parametrize("begins", [480 * 12, 480])
def test_in_a_file_a_rotor_that_stands_behind_an_outage_tells_no_arc(begins: int) -> None:
    """Its spans agree as well."""
    wheel = Wheel(TURN)
    wheel.tell_time(PACKET_NS, passes=False)
    wheel.follow(heads(*turning(*[480] * 40)), [(40, 40 * PACKET_NS)])
    arcs = wheel.follow(heads(*turning(*[480] * 10, begins, *[0] * 8, 480, 480)), [(21, 90 * PACKET_NS)])
    assert (arcs.arc > 0).sum() >= 10
    assert np.isfinite(arcs.arc).all()


@pytest.mark.parametrize("stood", [(), (1,), (0,), (1, 0, 0, 1, 0), (1,) * 40])
def test_in_a_file_a_rotor_that_stood_is_at_speed_again(stood: tuple[int, ...]) -> None:
    """Packets that it did not send meanwhile are none that were lost."""
    wheel, missing = Wheel(TURN, 40), list[int]()
    wheel.tell_time(31_250.0, passes=False)
    spans = [*[288] * 160, *(288 - 7 * each for each in range(40)), *stood, *[288] * 400]
    first, following = turning(*spans)
    headings = [*first.tolist(), following]
    for begin in range(0, len(spans), 80):
        end = min(begin + 80, len(spans))
        arcs = wheel.follow(heads(headings[begin:end], headings[end], 40), [(end - begin, 0)])
        missing.append(lost(arcs))
    assert not any(missing)
    assert np.asarray(arcs.arc).tolist() == spans[begin:]
