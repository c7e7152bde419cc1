"""Where the place of the mark moves from revolution to revolution, the scans do not depend on how packets come.

Point clouds with numbered samples. Marks stand where they like, and some of them are lost, so that some revolutions
end where the headings pass the mark before.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lidario.families.rplidar.simulated.packers import pack_standard
from lidario.families.ydlidar.simulated.packers import pack_points, start_control
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.sectors import SectorAssembler
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
from lidario.wire.blocks import Block, join_blocks
from lidario.wire.events import Packets
from tests.support.cases import CASES, Case
from tests.support.streams import stream_of

FOUR_ROS = next(case for case in CASES if case.name == "ydlidar_4ros_room10")
NODES = next(case for case in CASES if case.name == "rplidar_32k_81")
TURN = 480
"""Samples of 360 degrees."""
STEP_Q6 = 360 * 64 // TURN
LONGEST = 40
"""Samples of an ordinary packet."""
SAMPLE_NS = 50_000


class Sent(NamedTuple):
    """A packet, and the number of its first sample behind it."""

    data: bytes
    end: int


def packets_of(marks: Sequence[tuple[int, bool]]) -> list[Sent]:
    """One revolution from mark to mark.

    Args:
        marks: Of each revolution: the samples by which its mark stands behind the place where the first one may
            stand, and whether its start packet is lost.
    """
    places = [TURN * number + moved for number, (moved, _) in enumerate(marks)]
    sent: list[Sent] = []
    for (begin, end), (_, lost) in zip(pairwise(places), marks, strict=False):
        if not lost:
            sent.append(packet_of(begin, begin + 1, start_control(10.0)))
        for first in range(begin + 1, end, LONGEST):
            sent.append(packet_of(first, min(first + LONGEST, end)))
    return sent


def packet_of(first: int, end: int, control: int = 0) -> Sent:
    angles = [number * STEP_Q6 % (360 * 64) for number in (first, end - 1)]
    return Sent(pack_points(np.arange(first, end) + 1000, *angles, control=control), end)


def runs_of(sent: Sequence[Sent], together: int, *, at_once: bool) -> Iterator[Packets]:
    """So many packets a call; each has a time of its own, or all of a call come `at_once`."""
    for begin in range(0, len(sent), together):
        some = sent[begin : begin + together]
        blocks: list[Block] = []
        join_blocks(blocks, [Block(len(each.data), 1) for each in some])
        arrivals = tuple((place, each.end * SAMPLE_NS) for place, each in enumerate(some, 1))
        yield Packets(b"".join(each.data for each in some), tuple(blocks), arrivals[-1:] if at_once else arrivals)


class Made(NamedTuple):
    """What became of a stream."""

    scans: list[Scan]
    sectors: list[Sector]
    stats: AssemblerStats


def made(runs: Iterator[Packets], parts: int = 0, case: Case = FOUR_ROS) -> Made:
    """The scans of a stream, and the sectors where it is divided into `parts`."""
    sectors: list[Sector] = []
    assembler = SectorAssembler(stream_of(case, sample_ns=float(SAMPLE_NS)))
    if parts:
        assembler.divide((parts,), lambda _, sector: sectors.append(sector))
    scans = [scan for run in runs for scan in assembler.add(run)]
    return Made(scans, sectors, assembler.stats)


def assert_same_samples(found: Sequence[Scan | Sector], expected: Sequence[Scan | Sector]) -> None:
    assert [len(each) for each in found] == [len(each) for each in expected]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.device_angles, other.device_angles)
        np.testing.assert_array_equal(one.device_distances, other.device_distances)
        assert (one.seq, one.lost_packets) == (other.seq, other.lost_packets)


def assert_same_times(found: Sequence[Scan | Sector], expected: Sequence[Scan | Sector]) -> None:
    for one, other in zip(found, expected, strict=True):
        assert (one.stamp_ns, one.duration_ns) == (other.stamp_ns, other.duration_ns)
        np.testing.assert_equal(one.rpm, other.rpm)


LOST_AND_MOVED = [(0, False), (0, False), (0, False), (0, True), (14, False), (14, False), (14, False), (14, False)]
"""A start packet is lost, and the next mark stands 14 samples farther on."""


def test_a_revolution_without_its_mark_begins_where_the_one_before_did() -> None:
    found = made(runs_of(packets_of(LOST_AND_MOVED), 1000, at_once=True))
    assert [len(scan) for scan in found.scans] == [480, 480, 480, 479, 494, 480]
    assert [float(scan.device_angles[0]) for scan in found.scans] == [0, 0, 0, 0.75, 0, 10.5]


DRIFTING = [(14 * number, False) for number in range(9)]
"""Each mark stands 14 samples farther on, behind a packet that has passed the one before."""

FAR_AND_LOST = [(0, False), (0, False), (0, False), (58, False), (-3, True), (19, False), (-15, False), (0, False)]
"""One mark stands so far off that the revolution before it is only a part."""

marks = st.lists(st.tuples(st.integers(-60, 60), st.booleans()), min_size=4, max_size=9)


def assert_the_same_in_any_pieces(sent: Sequence[Sent], parts: int = 0) -> None:
    single = made(runs_of(sent, 1, at_once=False), parts)
    for together in (5, len(sent)):
        found = made(runs_of(sent, together, at_once=False), parts)
        assert_same_samples(found.scans, single.scans)
        assert_same_times(found.scans, single.scans)
        assert found.stats == single.stats
        assert_same_samples(found.sectors, single.sectors)


@pytest.mark.long
@pytest.mark.parametrize("parts", [0, 4])
@given(marks=marks)
@example(marks=LOST_AND_MOVED)
@example(marks=DRIFTING)
def test_how_packets_come_changes_no_scan(marks: list[tuple[int, bool]], parts: int) -> None:
    sent = packets_of([(0, False), *marks])
    assert_the_same_in_any_pieces(sent, parts)
    # Decoded in blocks, where they can be.
    single, block = (made(runs_of(sent, together, at_once=True), parts) for together in (1, len(sent)))
    assert_same_samples(block.scans, single.scans)
    assert_same_samples(block.sectors, single.sectors)


@pytest.mark.long
@given(marks=marks, first=st.integers(0, 100), count=st.integers(1, 50))
@example(marks=FAR_AND_LOST, first=55, count=12)
def test_it_changes_none_where_packets_are_lost(marks: list[tuple[int, bool]], first: int, count: int) -> None:
    sent = packets_of([(0, False), *marks])
    del sent[first : first + count]
    if sent:
        assert_the_same_in_any_pieces(sent)


def nodes(first: int, end: int, marks: Sequence[int]) -> list[Sent]:
    """One node a degree, marked at these."""
    degrees = np.arange(first, end)
    raw = pack_standard(degrees % 360 * 64, np.full(len(degrees), 4000), 47, np.isin(degrees, marks))
    return [Sent(raw[5 * number : 5 * number + 5], number + 1) for number in range(len(degrees))]


@pytest.mark.parametrize("together", [1, 5, 10_000])
def test_the_first_part_of_a_stream_is_measured_from_the_seam_at_its_end(together: int) -> None:
    """Not from the place where a mark stands that comes later: nodes from 18 degrees on, marked at 40."""
    sent = nodes(18, 4 * 360, [2 * 360 + 40, 3 * 360 + 40])
    found = made(runs_of(sent, together, at_once=False), case=NODES)
    assert [scan.rpm for scan in found.scans] == pytest.approx([60e9 / 360 / SAMPLE_NS] * 2)


@pytest.mark.parametrize("together", [1, 5, 10_000])
def test_the_first_mark_may_stand_elsewhere_by_right(together: int) -> None:
    """What began at 0 until it came was no revolution: nothing is broken. Nodes from 350 degrees on."""
    sent = nodes(350, 4 * 360, [360 + 270, 2 * 360 + 270, 3 * 360 + 270])
    found = made(runs_of(sent, together, at_once=False), case=NODES)
    assert [(len(scan), scan.device_angles[0]) for scan in found.scans] == [(360, 270)] * 2
    assert found.stats.broken_scans == 0


def test_sectors_are_counted_from_the_seam_where_packets_cross_it() -> None:
    """The mark stands at 75 degrees, and from the fourth revolution on each start packet is lost."""
    begin = 3 * TURN + 100
    sent = [*packets_of([(100, False)] * 4), packet_of(begin, begin + 1, start_control(10.0))]
    sent += [packet_of(first, first + 39) for first in range(begin + 1, 7 * TURN, 39)]
    found = made(runs_of(sent, 1, at_once=False), 72)
    assert {sector.seq for sector in found.sectors} == set(range(7))
    for sector in found.sectors:
        assert set((sector.device_angles - 75.0) % 360 // 5) == {sector.index}
