"""Streams of which all is known, with most of their packets or whole turns of them missing (`benchmarks.truth`)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest

from benchmarks.truth_cases import CASES, Case, Line, drifting, happen, lose, lose_share, lose_stretches
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import Score, is_right, score
from benchmarks.truth_streams import TrueStream
from benchmarks.truth_ways import receive

ONE_A_PARSER = ["0x81 S1", "0x82 A1", "0x83 HQ", "0x84 A3", "0x85 C1", "4ROS", "G4", "LD19"]
"""Formats that are cut or decoded by different code, or whose packets hold far fewer samples."""
HELD = ["braked by hand to 0.3 Hz in 20 ms", "standing for 3 s"]
every_format = pytest.mark.exhaustive("name", sample=ONE_A_PARSER, full=list(FORMATS))


def scored(name: str, case: str | Case, way: str = "read") -> Score:
    """What becomes of a stream of that format to which this happens: one of `CASES`, or another one."""
    stream, line = happen(CASES[case] if isinstance(case, str) else case, FORMATS[name])
    return score(stream, line, receive(stream, line, way), timed=way != "file")


def latest_ms(found: Score) -> float:
    """By how much the worst time is off."""
    assert found.times_off_ms is not None
    return found.times_off_ms[1]


def test_in_a_file_no_time_speaks_against_missing_nodes() -> None:
    """None passes there where they are missing."""
    found = scored("0x81 S1", "60 % of the packets gone", "file")
    assert found.told == pytest.approx(found.missing, rel=0.01)
    assert (found.wrong, found.told_revolutions) == (0, 0)


@every_format
@pytest.mark.parametrize(
    ("case", "way", "comes"),
    [
        ("each second packet gone", "read", 0.5),
        ("40 % of the packets gone", "file", 0.6),
        ("an outage of two turns", "read", 0.95),
    ],
)
def test_what_comes_is_delivered_and_what_does_not_is_told(name: str, case: str, way: str, comes: float) -> None:
    found = scored(name, case, way)
    assert found.kept > (comes - 0.04) * found.samples
    assert found.wrong <= 0.001 * found.samples
    assert abs(found.told_revolutions - found.missing_revolutions) <= 2
    # Of the first and the last, partial revolution too: time tells behind them that each second packet was lost.
    assert found.told == pytest.approx(found.missing, rel=0.017, abs=5)
    if case == "an outage of two turns":
        assert found.told_revolutions == found.missing_revolutions == 3
        assert found.told == pytest.approx(found.missing, rel=0.01, abs=4)


def assert_do_not_meet(found: Score) -> None:
    """Parts of two revolutions do not where a turn passes unseen, since time tells that it was longer."""
    assert found.mixed <= 0.02 * found.kept
    assert found.times_off_ms is None or found.times_off_ms[1] < 50


@pytest.mark.long
@every_format
def test_where_few_packets_come_the_speed_is_known_and_what_is_missing(name: str) -> None:
    found = scored(name, "2 % of the bytes lost", "read")
    assert_do_not_meet(found)
    if name in {"0x83 HQ", "0x86"}:
        return  # of the one no packet comes then, and of the other no two
    assert found.no_rpm <= found.delivered / 2 + 5
    assert found.rpm_off is not None or found.delivered < 5
    assert (found.rpm_off or (0.0,))[0] < 0.1
    assert abs(found.told_revolutions - found.missing_revolutions) <= 5
    assert 0.92 * found.missing < found.told < 1.02 * found.missing


def test_in_a_file_the_clock_of_the_device_tells_an_outage() -> None:
    found = scored("LD19", "an outage of two turns", "file")
    assert (found.told, found.told_revolutions, found.seq_off) == (found.missing, found.missing_revolutions, 0)


@every_format
@pytest.mark.parametrize(
    ("case", "off"),
    [("an outage of 0.8 s, then 40 % slower", 0.04), ("an outage of 0.3 s, then 30 % faster", 0.06)],
)
def test_a_rotor_may_turn_at_another_speed_behind_an_outage(name: str, case: str, off: float) -> None:
    found = scored(name, case, "read")
    assert found.told_revolutions == found.missing_revolutions
    assert found.told == pytest.approx(found.missing, rel=off, abs=2)
    assert found.wrong == 0


@every_format
def test_turns_that_hide_in_outages_are_not_taken_for_a_speed(name: str) -> None:
    """Of just over a turn, for some formats, from the first moment on."""
    found = scored(name, "an outage of 0.15 s each 0.35 s", "read")
    assert found.wrong <= 0.001 * found.samples
    assert found.told <= 1.04 * found.missing
    # The angles beside such a gap are those of one turn.
    assert_do_not_meet(found)


@every_format
def test_a_program_that_reads_late_dates_what_came_by_what_is_missing_behind_it(name: str) -> None:
    found = scored(name, "late by 1.3 s, 10 % gone", "read")
    assert (found.wrong, found.mixed, found.twice) == (0, 0, 0)
    assert (found.seq_off, found.told_revolutions, found.broken) == (0, 0, 0)
    assert found.told == pytest.approx(found.missing, rel=0.01, abs=2)
    assert latest_ms(found) < 25


def test_an_outage_within_one_late_read_is_told_by_the_clock_of_the_device() -> None:
    def damage(stream: TrueStream, random: np.random.Generator) -> Line:
        # The outages begin after 2 and 4 s; the second one lies within what a blocked program reads at once.
        return replace(lose_stretches(2.0, 0.5, stream, random), blocked_ns=(3.2e9, 4.6e9))

    found = scored("LD19", Case("an outage that is read late", damage, drifting))
    assert found.told_revolutions == found.missing_revolutions > 4
    assert (found.wrong, found.mixed, found.seq_off) == (0, 0, 0)
    assert latest_ms(found) < 5


@every_format
@pytest.mark.parametrize("way", ["read", "sectors", "file"])
def test_a_rotor_that_turns_twice_as_fast_behind_an_outage_did_not_lose_each_second_packet(
    name: str, way: str
) -> None:
    """That is known by time as soon as a few packets have come, or, where none tells, by packets that agree."""
    found = scored(name, "2 to 7 Hz, an outage of 1 s in it", way)
    assert found.kept > 0.7 * found.samples
    # In a file those of an A1 are too few to agree.
    assert found.wrong <= (0.02 * found.samples if way == "file" and name.endswith("A1") else 0)
    # What it turned meanwhile nobody knows.
    assert way != "read" or found.seq_off <= 2


@pytest.mark.parametrize("name", ["G4", "X4"])
def test_the_first_scan_of_a_device_that_tells_no_sample_time_is_dated_by_all_its_reads(name: str) -> None:
    """Within a packet, as all later ones are."""
    assert latest_ms(scored(name, "clean")) < FORMATS[name].samples * FORMATS[name].sample_ns * 1e-6


@pytest.mark.parametrize("case", ["an outage of 0.4 s each 0.6 s", "an outage of 0.7 s each second"])
@every_format
def test_a_revolution_that_came_whole_tells_its_speed_between_outages(name: str, case: str) -> None:
    """Hardly a revolution follows the one before, so that only its own reads can confirm its speed."""
    found = scored(name, case, "read")
    assert found.no_rpm <= 3
    assert abs(found.told_revolutions - found.missing_revolutions) <= 2 >= found.seq_off
    assert 0.94 * found.missing < found.told < 1.003 * found.missing + 3
    assert found.wrong <= 0.002 * found.samples


@every_format
def test_a_rotor_that_stands_for_a_while_is_not_taken_for_losses(name: str) -> None:
    found = scored(name, "standing for 0.5 s", "read")
    assert (found.told, found.told_revolutions, found.seq_off) == (0, 0, 0)
    assert found.delivered == found.revolutions
    # A packet in the midst of which the rotor stops has its samples at equal steps all the same.
    assert found.wrong <= 0.002 * found.samples
    assert found.overlap_ms < 60


@pytest.mark.long
@every_format
@pytest.mark.exhaustive(
    ("case", "way"), sample=[(HELD[0], "read"), (HELD[1], "file")], full=list(product(HELD, ["read", "file"]))
)
def test_a_rotor_that_is_held_is_not_taken_for_losses_whatever_time_says(name: str, case: str, way: str) -> None:
    """A revolution that takes longer than any such device needs is given up. Then it alone is told as missing."""
    found = scored(name, case, way)
    assert (found.told, found.seq_off) == (0, 0)
    assert found.told_revolutions == found.missing_revolutions <= 1
    assert found.wrong <= 0.003 * found.samples
    assert found.overlap_ms < 60


@every_format
def test_losses_of_a_rotor_that_stands_are_told_by_the_time_there_was(name: str) -> None:
    """The angles tell thousands; and no revolution passed, however long it stood, unless a silence is as long."""
    found = scored(name, "standing for 0.5 s, 60 % gone", "read")
    assert abs(found.told - found.missing) <= max(10, 0.032 * found.missing)
    assert found.told_revolutions <= found.missing_revolutions + 2 >= found.seq_off
    assert found.missing_revolutions <= 4
    assert found.wrong <= 0.002 * found.samples
    assert found.overlap_ms < 60


@pytest.mark.parametrize("name", ["0x82 A1", "0x84 A3", "0x85 C1", "LD19"])
def test_what_came_before_and_behind_a_stand_is_not_one_sector_where_most_is_lost(name: str) -> None:
    found = scored(name, "standing for 0.5 s, 60 % gone", "sectors")
    assert found.wrong == 0
    assert latest_ms(found) < 60


@every_format
def test_of_a_rotor_that_stands_so_long_that_the_revolution_is_given_up_time_tells_what_is_lost(name: str) -> None:
    """But for the part behind, which ends where the rotor has turned: there only angles do."""
    case = replace(CASES["standing for 3 s"], damage=partial(lose_share, 5, spoilt=False))
    found = scored(name, case)
    assert 0.7 * found.missing < found.told <= found.missing + 10
    assert found.told_revolutions == found.missing_revolutions <= 1
    assert found.wrong <= 0.003 * found.samples


@pytest.mark.long
@every_format
@pytest.mark.parametrize(
    "case",
    [
        "10 to 1 Hz in 1 s",
        "0.5 to 10 Hz in 3 s",
        "from rest",
        "5 to 10 Hz in 0.5 s",
        "4 to 1 Hz in 0.5 s, at once",
        "spinning up in jerks of 2 to 7.6 Hz",
        "5 % of the packets twice",
        "late by 2 s",
    ],
)
def test_on_an_undamaged_line_nothing_is_told_as_lost(name: str, case: str) -> None:
    found = scored(name, case, "read")
    assert (found.told, found.wrong) == (0, 0)
    # An LD19 turns faster than this: four of its revolutions are broken, and three too many told as missing.
    spare = 3 if (name, case) == ("LD19", "10 to 1 Hz in 1 s") else 0
    assert found.missing_revolutions <= found.told_revolutions <= found.missing_revolutions + spare


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "case"),
    [
        ("0x85 S2", "40 % of the packets spoilt"),
        ("0x85 S2", "2 % of the bytes lost"),
        ("0x82 A2", "1 % of the bytes flipped"),
    ],
)
def test_noise_that_passes_for_packets_is_not_told_as_gaps(name: str, case: str) -> None:
    """Of eight check bits, one packet of 256 that are damaged passes."""
    found = scored(name, case, "read")
    assert found.told == pytest.approx(found.missing, rel=2 / 256)
    assert found.delivered <= found.revolutions
    assert found.told_revolutions == found.missing_revolutions


@pytest.mark.parametrize(
    ("name", "case"), [("0x85 C1", "each second packet spoilt"), ("0x85 S1", "1 % of the bytes flipped")]
)
def test_noise_that_passes_for_an_end_makes_no_revolution_more(name: str, case: str) -> None:
    """By time, the revolution that would begin there had begun a whole one before."""
    found = scored(name, case, "read")
    assert found.seq_off == 0
    assert found.delivered <= found.revolutions
    assert found.told_revolutions <= found.missing_revolutions + 1


def test_a_revolution_whose_angles_are_not_certain_is_not_delivered() -> None:
    """As the first one, where it has lost more packets than it has left."""
    found = scored("0x82 A1", "60 % of the packets gone", "file")
    assert found.wrong == 0
    assert found.told_revolutions == found.missing_revolutions > 0


@pytest.mark.long
@every_format
def test_sectors_change_nothing_of_the_scans_where_each_second_packet_is_lost(name: str) -> None:
    """Time tells that half is missing, also where a read is decoded in parts. Before that, some may be wrong."""
    stream, line = happen(CASES["each second packet gone"], FORMATS[name])
    divided, whole = receive(stream, line, "sectors"), receive(stream, line, "read")
    assert [scan.seq for scan in divided.scans] == [scan.seq for scan in whole.scans]
    assert len(divided.sectors) > 7 * len(whole.scans)
    assert all(is_right(stream, scan) for scan in divided.scans[1:])
    assert all(is_right(stream, sector) for sector in divided.sectors if sector.seq > 1)


@pytest.mark.parametrize("name", ["0x84 A3", "4ROS", "0x81 S1"])
def test_what_passed_unseen_before_a_sector_is_told_once(name: str) -> None:
    found = scored(name, "an outage of 0.7 s each second", "sectors")
    assert found.told_revolutions == found.missing_revolutions > 30


@pytest.mark.parametrize("case", ["braked by hand to 0.3 Hz in 20 ms", "standing for 0.5 s"])
def test_sectors_change_nothing_of_the_speed_where_it_leaps(case: str) -> None:
    stream, line = happen(CASES[case], FORMATS["0x82 A1"])
    divided, whole = ([scan.rpm for scan in receive(stream, line, way).scans] for way in ("sectors", "read"))
    assert divided == pytest.approx(whole, rel=1e-6, nan_ok=True)


@pytest.mark.long
@pytest.mark.parametrize("name", ONE_A_PARSER)
@pytest.mark.parametrize("case", ["an outage of 0.3 s", "20 % of the packets gone"])
def test_sectors_behind_gaps_are_dated_nearly_as_well_as_scans(name: str, case: str) -> None:
    """Packets behind a gap tell the time, too; where whole turns passed unseen, no sector comes behind it."""
    (of_sectors, most), (of_scans, _) = (
        scored(name, case, way).times_off_ms or (9, 0) for way in ("sectors", "read")
    )
    assert of_sectors < 2.5 * of_scans + 0.1
    assert most < 40


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
