"""Blocks to arrays and scans: the vendor's own figures, the scalar reference, and what is missing between scans."""

import numpy as np
import pytest

from lidario.families.hokuyo.decode import BlockDecoder
from lidario.families.hokuyo.formats import DistanceFormat
from lidario.families.hokuyo.geometry import Geometry
from lidario.families.hokuyo.simulated import pack_block
from lidario.families.stream import Stream
from lidario.revolution.whole import WholeAssembler, sectors_of
from lidario.scans.scan import Scan
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from tests.families.hokuyo.about import CASES, GEOMETRY, LAYOUTS
from tests.reference import hokuyo
from tests.support.case import Case
from tests.support.contents import any_packets
from tests.support.streams import in_one_run, stream_of

(CASE,) = CASES
(STRENGTH,) = LAYOUTS
MS = 1_000_000
TURN_NS = 100 * MS


def stream(**changes: object) -> Stream:
    return stream_of(CASE, **changes)


def at(block: bytes, ms: int) -> bytes:
    """The same block, measured at another time."""
    digits = "".join(chr(ms % (1 << 24) >> shift & 63) for shift in (18, 12, 6, 0))
    time = hokuyo.sealed("".join(chr(ord(each) + 0x30) for each in digits)).encode()
    return block[:20] + time + block[25:]


def scans_of(blocks: list[tuple[bytes, int]], assembler: WholeAssembler | None = None) -> list[Scan]:
    """The scans of blocks, each with the time when it came, in ns."""
    assembler = assembler or WholeAssembler(stream())
    found: list[Scan] = []
    for block, came_ns in blocks:
        found += assembler.add(Packets(block, (Block(len(block), 1),), ((1, came_ns),)))
    return found


@pytest.mark.parametrize("case", [CASE, STRENGTH], ids=lambda case: case.name)
def test_any_contents_decode_as_the_scalar_reference_decodes_them(case: Case) -> None:
    packets = any_packets(case, 5, 4, wild=True)
    samples = case.make_decoder().decode(in_one_run(case.make_format(), b"".join(packets)), None, 3)
    reference = case.decode(packets)
    np.testing.assert_array_equal(samples.distance_mm[3:], [each.distance_mm for each in reference])
    np.testing.assert_allclose(samples.angle_deg[3:], [each.angle_deg for each in reference], rtol=0, atol=2e-5)
    found = None if samples.intensity is None else samples.intensity[3:].tolist()
    assert found == case.intensities(reference)
    assert list(samples.ends) == [682, 1364, 2046, 2728]


@pytest.mark.parametrize("turn", [4, 7, 1024, 1440, 9999, 16_383, 16_384])
@pytest.mark.parametrize("front", [0, 384, 9999])
def test_no_step_of_any_field_is_at_360_degrees_or_more(turn: int, front: int) -> None:
    last = min(turn, 10_000) - 1
    block = pack_block(b"MD0000%04d01000" % last, 0, np.zeros(last + 1, np.int64))
    decoder = BlockDecoder(DistanceFormat, Geometry(0, last, front, turn, 20, 5600, 600))
    angles = decoder.decode(in_one_run(DistanceFormat(), block), None).angle_deg
    assert angles.min() >= 0
    assert angles.max() < 360


def test_a_scan_is_delivered_when_it_came_and_lasts_as_long_as_its_field() -> None:
    (scan,) = scans_of([(CASE.packets[0], TURN_NS)])
    assert len(scan) == GEOMETRY.steps
    assert scan.duration_ns == pytest.approx(682 * 97_656.25, abs=1)
    assert scan.rpm == pytest.approx(600)
    assert scan.stamp_ns < TURN_NS - scan.duration_ns + 2 * 97_657


def test_what_is_missing_between_two_scans_is_told_by_the_clock_of_the_device() -> None:
    """Also where the blocks behind came all at once, and across the end of the clock."""
    begin = (1 << 24) - 250
    stamps = [begin + 100 * number for number in (0, 1, 2, 5, 6, 7)]
    late = [TURN_NS, 2 * TURN_NS, 3 * TURN_NS, 8 * TURN_NS, 8 * TURN_NS, 8 * TURN_NS]
    blocks = [at(CASE.packets[0], ms) for ms in stamps]
    assembler = WholeAssembler(stream())
    scans = scans_of(list(zip(blocks, late, strict=True)), assembler)
    assert [scan.seq for scan in scans] == [0, 1, 2, 5, 6, 7]
    assert (assembler.stats.lost_packets, assembler.stats.missed_scans, assembler.stats.scan_packets) == (2, 2, 6)
    apart = np.diff([scan.stamp_ns for scan in scans]) / TURN_NS
    np.testing.assert_allclose(apart, [1, 1, 3, 1, 1], atol=0.02)
    joined = WholeAssembler(stream()).add(Packets(b"".join(blocks), (Block(2137, 6),), ((6, 8 * TURN_NS),)))
    assert [scan.seq for scan in joined] == [0, 1, 2, 5, 6, 7]


def test_times_that_nobody_can_mean_tell_a_bounded_number() -> None:
    """They come from a device, a peer or a file, and so would the numbers of all scans that follow."""
    assembler = WholeAssembler(stream())
    scans_of([(CASE.packets[0], TURN_NS), (CASE.packets[0], 1 << 61)], assembler)
    assert assembler.stats.missed_scans == 1_000_000


def test_late_blocks_are_dated_by_the_clock_of_the_device() -> None:
    """The line delays each by up to 60 ms; the two clocks differ by a thousandth."""
    random = np.random.default_rng(4)
    delays = random.integers(0, 60 * MS, 200)
    blocks = [(at(CASE.packets[0], 100 * n), round(n * TURN_NS * 1.001) + int(delays[n])) for n in range(200)]
    scans = scans_of(blocks)
    assert [scan.seq for scan in scans] == list(range(200))
    true = np.arange(200) * TURN_NS * 1.001
    off = np.array([scan.stamp_ns for scan in scans]) - true
    # Without that clock they differ by 60 ms.
    assert np.ptp(off[60:]) < 15 * MS


def test_whatever_the_clock_says_times_do_not_go_back() -> None:
    random = np.random.default_rng(4)
    blocks = [(at(CASE.packets[0], int(random.integers(1 << 24))), n * TURN_NS) for n in range(50)]
    assembler = WholeAssembler(stream())
    stamps = [scan.stamp_ns for scan in scans_of(blocks, assembler)]
    assert stamps == sorted(stamps)
    wild = WholeAssembler(stream()).add(Packets(b"".join(b for b, _ in blocks), (Block(2137, 50),), ((50, 0),)))
    stamps = [scan.stamp_ns for scan in wild]
    assert stamps == sorted(stamps)


def test_where_no_clock_is_believed_the_time_between_blocks_tells() -> None:
    blocks = [(CASE.packets[n], round(n * TURN_NS + (7 * n % 3) * 10 * MS)) for n in (0, 1, 2, 5, 6)]
    stored = WholeAssembler(stream(timed=False))
    assert [scan.seq for scan in scans_of(blocks, stored)] == [0, 1, 2, 5, 6]


def test_a_zero_offset_behind_the_next_scan_turns_the_one_behind_it() -> None:
    assembler, block = WholeAssembler(stream()), CASE.packets[0]
    scans = scans_of([(block, TURN_NS)], assembler)
    assembler.set_zero_offset(30.0, behind=True)
    scans += scans_of([(at(block, 1000 + 100 * each), (2 + each) * TURN_NS) for each in range(3)], assembler)
    begin = float(scans[0].device_angles[0])
    assert [round(float(scan.device_angles[0]) - begin) % 360 for scan in scans] == [0, 0, 30, 30]


def test_a_scan_that_comes_twice_is_delivered_once() -> None:
    assembler, block = WholeAssembler(stream()), CASE.packets[0]
    assert len(scans_of([(block, TURN_NS), (block, TURN_NS + MS)], assembler)) == 1
    assert (assembler.stats.doubled_packets, assembler.stats.missed_scans) == (1, 0)


@pytest.mark.parametrize("parts", [1, 3, 4, 8, 36, 360])
def test_sectors_hold_each_sample_once_and_none_beside_the_field(parts: int) -> None:
    (scan,) = scans_of([(CASE.packets[0], TURN_NS)])
    sectors = list(sectors_of(scan, parts))
    assert {each.field_of_view for each in sectors} == {scan.field_of_view}
    stamps = [each.stamp_ns for each in sectors]
    assert stamps == sorted(stamps)
    assert [each.index for each in sectors] == list(range(parts))
    np.testing.assert_array_equal(np.concatenate([each.device_angles for each in sectors]), scan.device_angles)
    np.testing.assert_array_equal(np.concatenate([each.times_ns for each in sectors]), scan.times_ns)
    for each in sectors:
        # How far the rotor had turned, counter-clockwise, since the field began.
        turned = (scan.seam - each.device_angles.astype(np.float64)) % 360
        assert (turned >= each.index * each.degrees - 1e-3).all()
        assert (turned <= (each.index + 1) * each.degrees + 1e-3).all()
        assert (len(each) == 0) == (each.index * each.degrees >= 239.6)
    empty = sectors[-1] if parts > 3 else None
    if empty is not None:
        assert (len(empty), empty.nearest(), empty.is_last, len(empty.xy())) == (0, None, True, 0)


def test_a_stream_that_ends_between_two_scans_of_one_read_counts_each_packet_once() -> None:
    assembler = WholeAssembler(stream())
    ready = assembler.ends(in_one_run(CASE.make_format(), b"".join(CASE.packets[:4])))
    assert len(next(ready)) == 1
    # The reader of the first scan has ended the stream.
    assembler.end()
    assert next(ready, None) is None
    counted = assembler.stats
    assert (counted.scan_packets, counted.discarded_packets, counted.unfinished_packets) == (1, 3, 0)
