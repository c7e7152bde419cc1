"""Reads that bring most of a revolution or several, of a line that loses packets, and of a rotor that stops."""

from dataclasses import replace

import pytest

from benchmarks.truth_cases import CASES
from benchmarks.truth_forms import FORMATS
from tests.revolution.test_known_truth import every_format, scored


@every_format
def test_a_read_for_each_revolution_tells_how_many_passed(name: str) -> None:
    """Equal times between reads fit several speeds; the packets of a read fill the time since the read before."""
    found = scored(name, "60 % gone, read each 100 ms")
    assert found.kept > 0.33 * found.samples
    assert found.wrong == 0
    assert found.told == pytest.approx(found.missing, rel=0.03)
    assert found.seq_off == 0
    assert found.no_rpm <= 12


@pytest.mark.parametrize(("name", "begin"), [("0x85 S2", 0.75), ("0x85 S2", 0.9), ("0x86", 0.75), ("LD19", 0.9)])
def test_a_first_speed_that_was_wrong_does_not_stay(name: str, begin: float) -> None:
    """Each second packet is lost, which only time tells, some revolutions later."""
    found = scored(name, replace(CASES["each second gone, read each 100 ms"], begin=begin))
    assert found.kept > 0.44 * found.samples
    assert found.told == pytest.approx(found.missing, rel=0.06)
    assert abs(found.told_revolutions - found.missing_revolutions) <= 3


@every_format
def test_reads_of_several_revolutions_end_each_in_its_time(name: str) -> None:
    """By what was measured behind it, with what is missing there."""
    found = scored(name, "each second gone, read each 0.2 to 0.3 s")
    assert found.kept > 0.36 * found.samples
    assert found.told == pytest.approx(found.missing, rel=0.06)
    assert abs(found.told_revolutions - found.missing_revolutions) <= 2


@pytest.mark.parametrize("name", ["0x82 A2", "0x82 A1", "0x85 S1", "X4"])
def test_a_rotor_that_starts_again_is_not_taken_for_losses(name: str) -> None:
    """Its first short arcs fit into each longer span, but more often than there was time for."""
    found = scored(name, "stop and go, 60 % gone")
    assert found.told == pytest.approx(found.missing, rel=0.05)
    assert found.wrong <= 0.02 * found.samples


@pytest.mark.parametrize("name", ["0x81 S1", "0x85 S2", "LD19"])
def test_a_rotor_that_stands_hides_no_revolution_between_reads(name: str) -> None:
    """Which all came with packets that fill the time between them."""
    case = CASES["stop and go, 20 % gone"]
    late = replace(case, damage=lambda stream, random: replace(case.damage(stream, random), pace_s=(0.1, 0.1)))
    found = scored(name, late)
    assert found.told == pytest.approx(found.missing, rel=0.01)
    assert abs(found.told_revolutions - found.missing_revolutions) <= 1 >= found.seq_off


@pytest.mark.long
@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("pace", ["100 ms", "0.2 to 0.3 s"])
def test_on_an_undamaged_line_coarse_reads_of_a_rotor_that_stops_lose_nothing(name: str, pace: str) -> None:
    found = scored(name, f"stop and go, read each {pace}")
    assert found.kept > 0.9998 * found.samples
    assert (found.wrong, found.told) == (0, 0)
    assert (found.delivered, found.told_revolutions) == (found.revolutions, 0)
