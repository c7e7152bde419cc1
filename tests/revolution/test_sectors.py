"""The sectors of a revolution are its scan in parts: the same samples, the same times, the same number.

Over every golden stream, in pieces of any size, whole and damaged; and what is counted meanwhile is what an
`Assembler` counts that hands out no sectors.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable, Container, Sequence
from dataclasses import fields
from itertools import accumulate
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
from tests.support.cases import CASES, KINDS, Case, most_or_all
from tests.support.harm import messes
from tests.support.kept import arrivals
from tests.support.numbered import DENSE
from tests.support.recorded import assert_same_scans
from tests.support.samples import one_a_parser
from tests.support.streams import Chunks, assembled, cut_up, in_one_run, open_stream
from tests.support.streams import stream_of as described

SAMPLE_DEG = 0.6
EXAMPLES = max(3, settings().max_examples // 8)
"""Fewer than of other properties: each is two whole streams and more, of up to 23 formats."""


class Divided(NamedTuple):
    """What became of a stream: scans, the sectors of each size, and the order in which they came."""

    scans: list[Scan]
    sectors: dict[int, list[Sector]]
    stats: AssemblerStats
    order: list[Scan | Sector]


def divided(
    case: Case,
    raw: bytes,
    parts: Sequence[int],
    chunks: Chunks = 64,
    times: Callable[[int], int] | None = None,
    **changes: object,
) -> Divided:
    pipeline = Pipeline(described(case, **changes), link=open_stream(case))
    sectors: dict[int, list[Sector]] = defaultdict(list)
    order: list[Scan | Sector] = []

    def publish(count: int, sector: Sector) -> None:
        sectors[count].append(sector)
        order.append(sector)

    pipeline.assembler.divide(parts, publish)
    clock = times or (lambda offset: round(offset * case.byte_ns))
    scans: list[Scan] = []
    pieces = list(cut_up(raw, chunks))
    for chunk, end in zip(pieces, accumulate(map(len, pieces)), strict=True):
        made = pipeline.receive(chunk, clock(end))
        scans += made
        order += made
    return Divided(scans, sectors, pipeline.stats, order)


def without(case: Case, gone: Container[int]) -> tuple[bytes, Callable[[int], int], list[int]]:
    """A stream less the packets with these numbers: its bytes, when the n-th comes, and the packets' sizes."""
    left = [number for number in range(len(case.packets)) if number not in gone]
    packets = [case.packets[number] for number in left]
    return b"".join(packets), arrivals(case, left), list(map(len, packets))


def assert_sum(found: Divided, count: int, *, stamps_ns: float, may_end: bool = False) -> None:
    """The sectors of each revolution that became a scan are that scan; or its beginning, where they `may_end`."""
    by_seq: dict[int, list[Sector]] = defaultdict(list)
    names = [(sector.seq, sector.index) for sector in found.sectors[count]]
    assert names == sorted(set(names))
    for sector in found.sectors[count]:
        assert {each.name for each in fields(Sector) if each.init} <= vars(sector).keys()
        by_seq[sector.seq].append(sector)
    assert by_seq
    seen = 0
    for scan in found.scans:
        sectors = by_seq[scan.seq]
        if not sectors:  # nothing is certain yet
            continue
        seen += 1
        came = sum(map(len, sectors))
        assert came == len(scan) or may_end
        for name in ("device_angles", "device_distances", "intensities", "angles", "ranges"):
            if getattr(scan, name) is None:
                assert all(getattr(sector, name) is None for sector in sectors)
                continue
            parts = [getattr(sector, name) for sector in sectors]
            np.testing.assert_array_equal(np.concatenate(parts), getattr(scan, name)[:came])
            assert not any(part.flags.writeable for part in parts)
            assert {part.dtype for part in parts} == {getattr(scan, name).dtype}
        times = np.concatenate([sector.times_ns for sector in sectors])
        late = times - scan.times_ns[:came]
        assert np.abs(late).max() <= stamps_ns
        assert {sector.mode for sector in sectors} == {scan.mode}
    assert seen >= len(found.scans) - 1


@most_or_all(CASES)
@pytest.mark.exhaustive("chunks", sample=[[7, 1, 300, 41]], full=[None, 64, [7, 1, 300, 41]])
def test_sectors_are_the_scan(case: Case, chunks: Chunks) -> None:
    found = divided(case, case.raw, (8,), chunks)
    plain = assembled(case, case.raw, chunks)
    packet_ns = case.byte_ns * (max(map(len, case.packets)) + 300)
    assert_sum(found, 8, stamps_ns=packet_ns if chunks else 1e9)
    assert found.stats == plain.stats
    assert_same_scans(found.scans, plain.scans)
    for one, other in zip(found.scans, plain.scans, strict=True):
        np.testing.assert_allclose(one.reported_rpm, other.reported_rpm, rtol=1e-12)
    assert not any(sector.lost_packets for sector in found.sectors[8])


@pytest.mark.long
@one_a_parser(KINDS)
def test_the_scan_in_which_the_last_reader_of_sectors_leaves_is_whole(case: Case) -> None:
    raw = case.raw[:30_000]
    for left_at in range(1000, len(raw) // 2, 1700):
        chunks = [50] * (left_at // 50) + [3000] * (len(raw) // 3000)
        pipeline = Pipeline(described(case), link=open_stream(case))
        pipeline.assembler.divide((8,), lambda *_: None)
        scans: list[Scan] = []
        at = 0
        for number, chunk in enumerate(cut_up(raw, chunks)):
            if number == left_at // 50:
                pipeline.assembler.divide((), lambda *_: None)
            at += len(chunk)
            scans += pipeline.receive(chunk, round(at * case.byte_ns))
        plain = assembled(case, raw, chunks)
        assert [(len(scan), scan.seq) for scan in scans] == [(len(scan), scan.seq) for scan in plain.scans]
        assert pipeline.stats == plain.stats


@pytest.mark.long
@one_a_parser(KINDS)
@pytest.mark.exhaustive("parts", sample=[(3, 8)], full=[(1,), (3, 8), (2, 36, 72)])
def test_sizes_do_not_disturb_each_other(case: Case, parts: tuple[int, ...]) -> None:
    found = divided(case, case.raw, parts)
    for count in parts:
        assert_sum(found, count, stamps_ns=2e9)
        if len(parts) == 1:
            continue
        alone = divided(case, case.raw, (count,)).sectors[count]
        for one, other in zip(found.sectors[count], alone, strict=True):
            assert (one.seq, one.index) == (other.seq, other.index)
            np.testing.assert_array_equal(one.device_angles, other.device_angles)


@one_a_parser(KINDS)
def test_a_sector_is_where_it_says(case: Case) -> None:
    """Up to what the format corrects by the distance, and to the size of a sample."""
    # A node has been corrected by the device: nobody else knows its beam.
    slack = SAMPLE_DEG + (15 if len(case.packets[0]) == 5 else case.correction_deg)
    for sector in divided(case, case.raw, (6,)).sectors[6]:
        away = (sector.device_angles - 60 * sector.index + 90) % 360 - 90
        assert ((away >= -slack) & (away < 60 + slack)).all()


@pytest.mark.long
@one_a_parser(KINDS)
def test_a_sector_comes_before_its_revolution_is_whole(case: Case) -> None:
    """After the packet behind its end, and not later."""
    found = divided(case, case.raw, (8,), [len(packet) for packet in case.packets])
    for scan in found.scans[1:]:
        place = next(at for at, each in enumerate(found.order) if each is scan)
        assert [(each.seq, getattr(each, "index", None)) for each in found.order[place - 8 : place]] == [
            (scan.seq, index) for index in range(8)
        ]


@st.composite
def losses(draw: st.DrawFn, case: Case) -> set[int]:
    """The packets of some stretches."""
    count = len(case.packets)
    gone: set[int] = set()
    for _ in range(draw(st.integers(1, 4))):
        begin = draw(st.integers(0, count - 1))
        gone |= set(range(begin, begin + draw(st.integers(1, max(1, count // 12)))))
    return gone


@pytest.mark.long
@one_a_parser(KINDS, CASES)
@settings(max_examples=EXAMPLES)
@given(st.data())
def test_sectors_are_the_scan_where_packets_are_lost(case: Case, data: st.DataObject) -> None:
    raw, times, _ = without(case, data.draw(losses(case), "gone"))
    found = divided(case, raw, (8,), data.draw(st.sampled_from([64, 500, 4000]), "chunk"), times)
    if found.sectors[8]:
        # Of a read that comes late, amid losses, nobody knows yet whether a turn passed unseen.
        assert_sum(found, 8, stamps_ns=5e9, may_end=True)


@pytest.mark.long
@most_or_all(CASES)
def test_samples_around_lost_packets_have_the_times_of_the_scan(case: Case) -> None:
    """From the first of the sector on, within a sample, whatever corrections have moved their angles by."""
    raw, times, sizes = without(case, range(20, len(case.packets), 40))
    found = divided(case, raw, (8,), sizes, times)
    checked = 0
    for scan in found.scans:
        begin = 0
        for sector in (each for each in found.sectors[8] if each.seq == scan.seq):
            since_ns = scan.times_ns[begin : begin + len(sector)] - scan.times_ns[begin]
            begin += len(sector)
            off_ns = np.abs(sector.times_ns - sector.stamp_ns - since_ns)
            assert off_ns.max() <= case.sample_us * 1e3
            ends_ns = sector.times_ns[-1] + sector.time_increment_ns
            assert sector.stamp_ns + sector.duration_ns == pytest.approx(ends_ns, abs=case.sample_us * 1e3)
            checked += sector.lost_packets
    assert checked > 1


def test_where_the_packet_at_the_seam_is_late_no_sector_is() -> None:
    """The others tell when the revolution began."""
    wire = DENSE.make_format()
    begins = wire.headings(in_one_run(wire, DENSE.raw))
    late = {at for at in range(len(begins) - 1) if begins[at] > begins[at + 1]}

    def clock(offset: int) -> int:
        return round(offset * DENSE.byte_ns) + 1_000_000 * (offset // 84 - 1 in late)

    assert_sum(divided(DENSE, DENSE.raw, (8,), 84, clock), 8, stamps_ns=500_000)


@pytest.mark.long
@one_a_parser(KINDS)
@pytest.mark.exhaustive("seed", sample=[0], full=range(3))
def test_what_is_counted_is_the_same(case: Case, seed: int) -> None:
    chance = random.Random(seed)
    gone: set[int] = set()
    for _ in range(3):
        begin = chance.randrange(len(case.packets))
        gone |= set(range(begin, begin + chance.randint(1, max(1, len(case.packets) // 50))))
    raw, times, _ = without(case, gone)
    found, plain = divided(case, raw, (8,), 64, times), assembled(case, raw, 64, times)
    assert plain.stats.lost_packets > 0
    assert found.stats == plain.stats
    assert [(scan.seq, scan.lost_packets, scan.stamp_ns) for scan in found.scans] == [
        (scan.seq, scan.lost_packets, scan.stamp_ns) for scan in plain.scans
    ]
    for scan in found.scans:
        sectors = [sector for sector in found.sectors[8] if sector.seq == scan.seq]
        if sectors and sectors[-1].is_last:
            # The arc of a node is a few units, and how many fit in a gap is a matter of one more or less.
            slack = 1 if case.response_type == 0x81 else 0
            assert abs(sum(sector.lost_packets for sector in sectors) - scan.lost_packets) <= slack


@pytest.mark.long
@pytest.mark.parametrize("parts", [8, 72])
@pytest.mark.parametrize("name", ["ydlidar_4ros_room10", "ydlidar_x4_11hz"])
def test_what_is_missing_right_behind_a_start_packet_is_told_with_a_sector(name: str, parts: int) -> None:
    """A start packet has one sample, which tells no step."""
    case = next(each for each in CASES if each.name == name)
    shortest = min(map(len, case.packets))
    gone = {number + 1 for number, packet in enumerate(case.packets) if len(packet) == shortest}
    raw, times, sizes = without(case, gone)
    found = divided(case, raw, (parts,), sizes, times)
    for scan in found.scans[1:-1]:
        told = [sector.lost_packets for sector in found.sectors[parts] if sector.seq == scan.seq]
        assert sum(told) == scan.lost_packets > 0


@pytest.mark.long
@pytest.mark.parametrize("name", ["rplidar_9k_82", "rplidar_a1_84", "ydlidar_4ros_room10"])
def test_a_lost_packet_is_told_with_the_sector_in_which_it_began(name: str) -> None:
    case, parts = next(each for each in CASES if each.name == name), 36
    wire = case.make_format()
    began = [float(wire.headings(in_one_run(wire, packet))[0]) / wire.full_turn for packet in case.packets]
    halfway = [number for number, turned in enumerate(began) if 0.3 < turned < 0.7]
    for lost in [number for number in halfway if number > case.turns[1][0].packet][:10]:
        raw, times, sizes = without(case, {lost, *range(case.turns[3][0].packet, len(case.packets))})
        found = divided(case, raw, (parts,), sizes, times)
        told = [sector.index for sector in found.sectors[parts] if sector.lost_packets]
        # By the samples before it, so that of one that begins at an end of a sector either of both may tell.
        assert told in [[int(began[lost] * parts + slack)] for slack in (-0.1, 0.1)]


@pytest.mark.parametrize(("begin", "gone"), [(0.0, (0, 1, 2)), (0.26, (3, 4))])
def test_a_sector_of_which_nothing_came_is_stepped_over(begin: float, gone: tuple[int, ...]) -> None:
    """From a bit behind the seam, or from the third sector on, the others keep their places."""
    wire = DENSE.make_format()
    began = [float(wire.headings(in_one_run(wire, packet))[0]) / wire.full_turn for packet in DENSE.packets]
    first, last = [number for number in range(1, len(began)) if began[number] < began[number - 1]][3:5]
    end = (max(gone) + 1) / 8
    lost = {number for number in range(first, last) if begin <= began[number] < end}
    raw, times, _ = without(DENSE, lost)
    found = divided(DENSE, raw, (8,), 84, times)
    (broken,) = [scan for scan in found.scans if scan.lost_packets]
    sectors = {sector.index: sector for sector in found.sectors[8] if sector.seq == broken.seq}
    # Samples of the packet before the gap may lie in the first of these sectors.
    assert set(range(8)) - set(gone) <= sectors.keys() <= set(range(8)) - set(gone[1:])
    for index, sector in sectors.items():
        away = (sector.device_angles - 45 * index + 90) % 360 - 90
        assert ((away >= -SAMPLE_DEG) & (away < 45 + SAMPLE_DEG)).all()
    assert sum(sector.lost_packets for sector in sectors.values()) == broken.lost_packets == len(lost)


@pytest.mark.long
@one_a_parser(KINDS, CASES)
@settings(max_examples=EXAMPLES)
@given(st.data())
def test_whatever_comes_sectors_are_in_order(case: Case, data: st.DataObject) -> None:
    raw = b"".join(data.draw(st.lists(messes(case), max_size=3), "stream"))
    clean = b"".join(case.packets[: case.turns[2][0].packet])
    found = divided(case, clean + raw + clean, (8, 60), data.draw(st.sampled_from([50, 5000]), "chunk"))
    for count in (8, 60):
        names = [(sector.seq, sector.index) for sector in found.sectors[count]]
        assert names == sorted(set(names))
        assert all(len(sector) and sector.lost_packets >= 0 for sector in found.sectors[count])
    assert found.stats.unfinished_packets >= 0
