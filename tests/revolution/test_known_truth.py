"""Streams of which all is known (`benchmarks.truth`), and of which something particular is missing or late.

What happens to all formats in all ways is in the rows of `tests/benchmarks/test_yardstick.py`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.truth_cases import CASES, Case, Line, drifting, happen, lose, lose_share, lose_stretches
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import Score, score
from benchmarks.truth_streams import TrueStream
from benchmarks.truth_ways import receive

ONE_A_PARSER = ["0x81 S1", "0x82 A1", "0x83 HQ", "0x84 A3", "0x85 C1", "4ROS", "G4", "LD19"]
"""Formats that are cut or decoded by different code, or whose packets hold far fewer samples."""


def scored(name: str, case: Case, way: str = "read") -> Score:
    """What becomes of a stream of that format to which this happens."""
    stream, line = happen(case, FORMATS[name])
    return score(stream, line, receive(stream, line, way), timed=way != "file")


def latest_ms(found: Score) -> float:
    """By how much the worst time is off."""
    assert found.times_off_ms is not None
    return found.times_off_ms[1]


def test_an_outage_within_one_late_read_is_told_by_the_clock_of_the_device() -> None:
    def damage(stream: TrueStream, random: np.random.Generator) -> Line:
        # The outages begin after 2 and 4 s; the second one lies within what a blocked program reads at once.
        return replace(lose_stretches(2.0, 0.5, stream, random), blocked_ns=(3.2e9, 4.6e9))

    found = scored("LD19", Case("an outage that is read late", damage, drifting))
    assert found.told_revolutions == found.missing_revolutions > 4
    assert (found.wrong, found.mixed, found.seq_off) == (0, 0, 0)
    assert latest_ms(found) < 5


@pytest.mark.exhaustive("name", sample=ONE_A_PARSER, full=list(FORMATS))
def test_of_a_rotor_that_stands_so_long_that_the_revolution_is_given_up_time_tells_what_is_lost(name: str) -> None:
    """But for the part behind, which ends where the rotor has turned: there only angles do."""
    case = replace(CASES["standing for 3 s"], damage=partial(lose_share, 5, spoilt=False))
    found = scored(name, case)
    assert 0.7 * found.missing < found.told <= found.missing + 10
    assert found.told_revolutions == found.missing_revolutions <= 1
    assert found.wrong <= 0.003 * found.samples


@pytest.mark.parametrize(("name", "begin"), [("0x85 S2", 0.75), ("0x85 S2", 0.9), ("0x86", 0.75), ("LD19", 0.9)])
def test_a_first_speed_that_was_wrong_does_not_stay(name: str, begin: float) -> None:
    """Each second packet is lost, which only time tells, some revolutions later."""
    found = scored(name, replace(CASES["each second gone, read each 100 ms"], begin=begin))
    assert found.kept > 0.44 * found.samples
    assert found.told == pytest.approx(found.missing, rel=0.06)
    assert abs(found.told_revolutions - found.missing_revolutions) <= 3


@pytest.mark.parametrize("name", ["0x81 S1", "0x85 S2", "LD19"])
def test_a_rotor_that_stands_hides_no_revolution_between_reads(name: str) -> None:
    """Which all came with packets that fill the time between them."""
    case = CASES["stop and go, 20 % gone"]
    late = replace(case, damage=lambda stream, random: replace(case.damage(stream, random), pace_s=(0.1, 0.1)))
    found = scored(name, late)
    assert found.told == pytest.approx(found.missing, rel=0.01)
    assert abs(found.told_revolutions - found.missing_revolutions) <= 1 >= found.seq_off


@pytest.mark.long
@pytest.mark.parametrize("name", ["4ROS", "X4", "G4"])
def test_sectors_behind_a_gap_behind_a_lone_sample_are_dated_by_the_usual_step(name: str) -> None:
    """The first packet of a revolution holds one sample: it tells no step, and so not what is missing behind it."""

    def lose_half_a_turn(stream: TrueStream, random: np.random.Generator) -> Line:
        turns, kept = stream.turns[stream.firsts[:-1]], np.ones(len(stream.firsts) - 1, np.bool_)
        for start in np.flatnonzero(np.diff(stream.firsts) == 1)[5::2].tolist():
            kept[start + 1 :] &= (turns[start + 1 :] > turns[start] + 0.5) | (turns[start + 1 :] < turns[start])
        return lose(stream, kept, random, spoilt=False)

    found = scored(name, Case("", lose_half_a_turn, drifting), "sectors")
    assert found.told == found.missing > 0
    # The lone sample itself is dated by the read that it came in; the next one comes within 60 ms.
    assert latest_ms(found) < 60


@pytest.mark.long
@pytest.mark.parametrize("name", ["0x82 A2", "0x83 HQ", "0x84 A1", "0x85 S2", "4ROS", "X4", "LD19"])
def test_no_sector_goes_on_behind_an_outage_of_nearly_a_turn(name: str) -> None:
    """The angles fall back there by so little that the revolution seems to go on."""
    outages = partial(lose_stretches, 1.37, 0.93 / FORMATS[name].hertz)
    found = scored(name, Case("", outages, drifting, 7.0), "sectors")
    assert found.mixed <= 0.002 * found.samples
    assert found.kept > 0.82 * found.samples


@pytest.mark.long
@pytest.mark.parametrize(("name", "turns"), [("0x85 S1", 0.93), ("0x82 A2", 0.96)])
def test_packets_that_seem_to_turn_back_may_hide_a_turn(name: str, turns: float) -> None:
    """Time need not tell all of it: a read alone may be late."""
    outages = partial(lose_stretches, 1.37, turns / FORMATS[name].hertz)
    found = scored(name, Case("", outages, drifting, 7.0))
    assert (found.mixed, found.wrong) == (0, 0)


@pytest.mark.parametrize("name", ["0x82 A1", "0x84 A3"])
def test_while_a_rotor_speeds_up_lost_packets_cost_no_revolution(name: str) -> None:
    """From rest, so that its arcs are many times as long at the end of a revolution as at the beginning."""

    def starting(hertz: float, seconds: NDArray[np.float64]) -> NDArray[np.float64]:
        return -hertz * np.expm1(-np.maximum(seconds - 1.0, 0.0) / 1.2)

    case = Case("starting slowly", partial(lose_share, 2, spoilt=False), starting, 4.0, begin=0.88)
    found = scored(name, case)
    assert (found.delivered, found.told_revolutions, found.wrong) == (found.revolutions, 0, 0)
