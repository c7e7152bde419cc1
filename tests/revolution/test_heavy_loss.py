"""Most packets are lost, by bytes that are missing everywhere: what is told stays within what can be true."""

from functools import cache

import numpy as np
import pytest

from benchmarks import damage
from benchmarks.streams import KINDS, capture
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
from lidario.wire.envelope import DESCRIPTOR_SIZE
from tests.fuzz.checks import check_scan
from tests.support import cases
from tests.support.streams import open_stream, stream_of
from tests.support.turns_4ros import SAMPLE_NS, scans_of, turn_of

SECONDS = 6.0


@cache
def thinned(name: str, share: float, seed: int) -> tuple[list[Scan], AssemblerStats, int]:
    """Scans, counters and the number of packets that came, of six seconds that lose a share of their bytes."""
    raw = np.frombuffer(capture(KINDS[name], SECONDS), np.uint8)[DESCRIPTOR_SIZE:]
    left = np.flatnonzero(np.random.default_rng(seed).random(len(raw)) >= share)
    scans, stats, packets, _ = damage.received(KINDS[name], raw[left], left)
    return scans, stats, packets


@pytest.mark.long
def test_a_false_mark_just_behind_the_beginning_makes_no_scan_of_what_lies_before_it() -> None:
    """It moves the seam by less than a twelfth of a revolution, and nothing checks that it is one."""
    kind = KINDS["0x81 nodes"]
    raw = np.frombuffer(capture(kind, 1.5), np.uint8)
    left = np.random.default_rng(0).random(len(raw) - DESCRIPTOR_SIZE) >= 0.02
    pipeline, scans, sectors = Pipeline(kind.stream()), list[Scan](), list[Sector]()
    pipeline.assembler.divide([1], lambda _, sector: sectors.append(sector))
    for begin in range(0, len(left), 512):
        part = slice(begin, begin + 512)
        came = raw[DESCRIPTOR_SIZE:][part][left[part]].tobytes()
        scans += pipeline.receive(came, round(1.5e9 * part.stop / len(raw)))
    assert len(scans) >= 9
    assert min(len(scan) for scan in scans) > 2000
    numbers = [sector.seq for sector in sectors]
    assert len(numbers) >= 9
    assert numbers == sorted(set(numbers))


@pytest.mark.exhaustive("seed", sample=[2, 4], full=range(1, 6))
def test_start_packets_alone_tell_how_many_revolutions_passed(seed: int) -> None:
    """All of them begin at the same angle; nothing but the time between them tells the speed."""
    clean, _, sent = thinned("4ROS points", 0.0, 1)
    scans, stats, packets = thinned("4ROS points", 0.1, seed)
    told = len(scans) + stats.missed_scans
    # Where most of them are lost too, six seconds bring too few.
    assert told <= len(clean) + 1
    assert told >= (0.8 * len(clean) if packets > 17 else 10)
    # What an ordinary packet holds is not known. As many as the longest ones make, are told.
    assert 0.3 * (sent - packets) < stats.lost_packets < sent - packets


@pytest.mark.exhaustive(
    "name", sample=["0x84 ultra", "4ROS points"], full=[name for name in KINDS if "81" not in name]
)
def test_a_stretch_in_which_hardly_a_packet_comes_is_told_when_it_has_ended(name: str) -> None:
    raw = np.frombuffer(capture(KINDS[name], SECONDS), np.uint8)[DESCRIPTOR_SIZE:]
    places = np.arange(len(raw))
    bad = (places > len(raw) * 0.4) & (places < len(raw) * 0.7)
    left = places[~bad | (np.random.default_rng(1).random(len(raw)) >= 0.1)]
    scans, stats, packets, _ = damage.received(KINDS[name], raw[left], left)
    clean, _, sent = thinned(name, 0.0, 1)
    assert len(scans) + stats.missed_scans == len(clean)
    # Of a 4ROS, short packets come all the time.
    assert 0.9 * (sent - packets) < stats.lost_packets <= sent - packets + 2


@pytest.mark.parametrize("kept", [[0, -1], [0, 6, -1], [0, 1]], ids=str)
def test_where_mostly_short_packets_come_a_revolution_is_as_long_as_its_angles_tell(kept: list[int]) -> None:
    """A packet that is missing held more than the mean of those that came."""
    turn = turn_of([1, *[43] * 11, 6])
    there = [at % len(turn) for at in kept]
    gone = [(number, at) for number in range(3, 9) for at in range(len(turn)) if at not in there]
    scans, stats = scans_of([turn] * 12, gone)
    assert [scan.seq for scan in scans] == list(range(11))
    assert (stats.lost_packets, stats.broken_scans, stats.missed_scans) == (len(gone), 0, 0)
    durations = np.array([scan.duration_ns for scan in scans]) / SAMPLE_NS
    np.testing.assert_allclose(durations, sum(packet[3] for packet in turn), rtol=0.02)


@pytest.mark.parametrize("number", [3, [3, 5], [3, 4, 5]], ids=str)
def test_a_revolution_of_which_one_packet_comes_is_told_by_its_time(number: int | list[int]) -> None:
    """Its angles tell nothing of those that are missing."""
    turn = turn_of([1, *[43] * 11, 6])
    alone = np.atleast_1d(number).tolist()
    gone = [(each, at) for each in alone for at in range(1, len(turn))]
    scans, stats = scans_of([turn] * 9, gone)
    assert [scan.seq for scan in scans] == [seq for seq in range(8) if seq not in alone]
    assert (stats.lost_packets, stats.broken_scans, stats.missed_scans) == (len(gone), len(alone), len(alone))


@pytest.mark.exhaustive("case", sample=cases.KINDS)
def test_a_step_from_sample_to_sample_never_becomes_too_small_to_be_one(case: cases.Case) -> None:
    """However often time says that nearly all is missing."""
    together = 20 if len(case.packets[0]) == 5 else 1
    packets = case.packets[:: 30 if together > 1 else 3]
    pipeline, now = Pipeline(stream_of(case), 115_200, link=open_stream(case)), 0
    for begin in range(0, 7000 * together // 20, together):
        now += 500_000_000_000
        piece = [packets[number % len(packets)] for number in range(begin, begin + together)]
        for scan in pipeline.receive(b"".join(piece), now):
            check_scan(scan)
