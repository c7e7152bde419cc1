"""From packets to revolutions: seams, losses, and what a scan promises of its arrays.

Most tests use packets whose samples are numbered (`tests.support.numbered`).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lidario import decode
from lidario.families.rplidar.simulated import packers
from lidario.families.ydlidar import formats as ydlidar_formats
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.revolution.clock import Beginning, RevolutionClock
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.seam import Split
from lidario.scans.scan import Scan
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets
from tests.support.cases import CASES, KINDS, Case
from tests.support.numbered import BAUD, DENSE, SAMPLE_NS, TURN, Arrival, assemble, numbered, numbers, on_time
from tests.support.streams import arrived, cut_up, in_one_run, open_stream, stream_of

# ----------------------------------------------------------------------------------------------------- seams


@pytest.mark.long
@example(arc=960.0, first=0, run=1)  # turns that end with a packet
@given(arc=st.floats(200, 6000), first=st.integers(0, TURN - 1), run=st.integers(1, 90))
def test_every_sample_is_in_the_turn_it_belongs_to(arc: float, first: int, run: int) -> None:
    stats = AssemblerStats()
    scans = assemble(numbered(260, arc, first), run=run, stats=stats)
    found = numbers(scans)
    assert len(scans) == stats.scans >= 1
    assert (stats.broken_scans, stats.lost_packets) == (0, 0)
    # One after the other without a hole, from scan to scan.
    assert found == list(range(found[0], found[0] + len(found)))
    for number, scan in enumerate(scans):
        angles = scan.device_angles
        assert (np.diff(angles) > 0).all()
        # Between the last sample of one turn and the first of the next lies no more than a step.
        assert angles[0] < arc / 64 / 39 + 1e-3
        assert angles[-1] > 360 - arc / 64 / 39 - 1e-3
        assert scan.seq == number
        assert scan.lost_packets == scan.dropped_before == 0


# -------------------------------------------------------------------------------------------- losses, endings


def without(packets: list[bytes], *lost: int) -> tuple[list[bytes], Arrival]:
    """The packets but for those, and when each of the others arrives."""
    left = [number for number in range(len(packets)) if number not in lost]
    return [packets[number] for number in left], lambda place: on_time(left[place])


@pytest.mark.parametrize("first", [0, 480, 720])
@pytest.mark.parametrize(("before", "behind"), [(1, 0), (1, 1), (3, 12), (12, 3), (0, 2)])
def test_a_gap_across_the_seam_is_told_by_both_revolutions(before: int, behind: int, first: int) -> None:
    """Each tells its own part; a packet across the seam is of the one in which most of it lies."""
    stats = AssemblerStats()
    scans = assemble(*without(numbered(24 * 5 + 1, 960, first), *range(48 - before, 48 + behind)), stats=stats)
    told = [scan.lost_packets for scan in scans]
    assert sum(told) == before + behind == stats.lost_packets
    for lost, scan in zip(told, scans, strict=True):
        assert abs(960 - len(scan) - 40 * lost) <= 20


@pytest.mark.parametrize("ordinary", [0, 1, 2])
@pytest.mark.parametrize("name", ["ydlidar_4ros_room10", "ydlidar_x4_11hz"])
def test_a_start_packet_that_is_missing_is_told_by_the_revolution_that_it_begins(name: str, ordinary: int) -> None:
    """It holds one sample, those behind it forty: what lies behind the seam is told by samples."""
    case = next(each for each in CASES if each.name == name)
    starts = [at for at, packet in enumerate(case.packets) if packet[2] & 1]
    gone = range(starts[3], starts[3] + 1 + ordinary)
    left = [packet for at, packet in enumerate(case.packets) if at not in gone]
    whole, scans = (list(decode(b"".join(each), family="ydlidar")) for each in (case.packets, left))
    told = [scan.lost_packets for scan in scans]
    missing = [len(one) - len(other) for one, other in zip(whole, scans, strict=True)]
    assert sum(told) == len(gone)
    assert [bool(lost) for lost in told] == [bool(samples) for samples in missing]


@pytest.mark.parametrize(("count", "lost"), [(24 * 3, (50, 60, 61)), (51, (49,)), (51, ())])
def test_what_is_missing_in_the_revolution_in_the_making_is_told_when_the_stream_ends(
    count: int, lost: tuple[int, ...]
) -> None:
    stats = AssemblerStats()
    assembler = Assembler(stream_of(DENSE, sample_ns=float(SAMPLE_NS)), BAUD, stats=stats)
    packets, arrival = without(numbered(count, 960), *lost)
    for place, packet in enumerate(packets):
        assembler.add(arrived(packet, 1, round(arrival(place))))
    assert (stats.scans, stats.lost_packets) == (1, 0)
    for _ in range(2):
        assembler.end()
        assert (stats.lost_packets, stats.broken_scans, stats.missed_scans) == (len(lost), 0, 0)


@pytest.mark.parametrize(("away", "missed"), [(0.0, 1), (0.4, 1), (0.6, 1), (1.6, 2), (3.9, 4)])
def test_a_stream_that_goes_on_has_missed_at_least_one_revolution(away: float, missed: int) -> None:
    """However soon it is back: its first revolution is the rest of one."""
    stats = AssemblerStats()
    before = assemble(numbered(24 * 3 + 1, 960), stats=stats)
    stats.leave_off(before[-1])
    # The last scan lasted a turn. Then it was away, and the next stream begins with a tenth of a turn.
    came_ns = before[-1].stamp_ns + before[-1].duration_ns + away * 960 * SAMPLE_NS
    behind = assemble(numbered(24 * 3, 960, TURN - 2304), lambda number: came_ns + on_time(number), stats=stats)
    assert [scan.seq for scan in behind] == [before[-1].seq + 1 + missed, before[-1].seq + 2 + missed]
    assert stats.missed_scans == missed


@pytest.mark.parametrize("lost", [1, 3, 5])
def test_a_gap_behind_the_first_packet_of_a_stream_is_not_stretched_over(
    lost: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That packet crosses the seam. How far it reaches is only known when the revolution has ended."""
    first, before = TURN - 512, list[int]()

    def told(tell: Callable[[RevolutionClock, Beginning], Any]) -> Callable[[RevolutionClock, Beginning], Any]:
        def telling(clock: RevolutionClock, here: Beginning) -> Any:
            before.append(here.packets_before)
            return tell(clock, here)

        return telling

    for name in ("follow", "settle"):
        monkeypatch.setattr(RevolutionClock, name, told(getattr(RevolutionClock, name)))
    scans = assemble(*without(numbered(24 * 4, 960, first), *range(1, 1 + lost)))
    assert [scan.lost_packets for scan in scans] == [lost, 0, 0]
    # Only the first packet came before the first whole revolution. Those that are missing belong to it.
    assert before == [0, 1, 25, 49]
    for scan in scans:
        expected = (first / 64 + (scan.device_distances.astype(np.float64) - 1) * 0.375) % 360
        np.testing.assert_allclose(scan.device_angles, expected, atol=1e-4)


@pytest.mark.long
def test_a_turn_that_never_ends_is_given_up_and_does_not_grow() -> None:
    stats = AssemblerStats()
    lead, still = numbered(60, 960), packers.pack_dense([11520], [[1] * 40])
    follow = numbered(100, 960, 11520)
    packets = [*lead, *[still] * 4000, *follow]
    assembler = Assembler(stream_of(DENSE, sample_ns=float(SAMPLE_NS), slowest_turn_s=0.4), BAUD, stats=stats)
    scans, held = [], 0
    for number, packet in enumerate(packets):
        scans += assembler.add(arrived(packet, 1, round(on_time(number))))
        held = max(held, sum(run.count for run in assembler.partial.runs))
    # Four times the slowest turn is 1280 packets.
    assert 1200 <= held <= 1300
    assert stats.broken_scans == 1
    assert len(scans) == 1 + 3
    assert all(len(scan) == 960 for scan in scans)
    # All that the rotor did came: no packet is missing, and no revolution but the one that was given up.
    assert stats.lost_packets == 0
    assert [scan.seq for scan in scans] == [0, 2, 3, 4]


# ---------------------------------------------------------------------------------------------------- arrays


@pytest.mark.exhaustive("case", sample=KINDS)
def test_what_a_scan_promises(case: Case) -> None:
    assembler = Assembler(stream_of(case))
    scans = assembler.add(in_one_run(case.make_format(), case.raw, 10**9))
    assert len(scans) == len(case.turns)
    for scan in scans:
        arrays = [scan.angles, scan.ranges, scan.device_angles, scan.device_distances]
        assert {array.dtype for array in arrays} == {np.dtype(np.float32)}
        if scan.intensities is not None:
            assert scan.intensities.dtype == np.uint8
            arrays.append(scan.intensities)  # type: ignore[arg-type]
        assert {array.shape for array in arrays} == {(len(scan),)}
        for array in arrays:
            assert not array.flags.writeable
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0
        assert ((scan.device_angles >= 0) & (scan.device_angles < 360)).all()
        assert (np.abs(scan.angles) <= np.float32(np.pi)).all()
        # Counter-clockwise radians against clockwise degrees.
        np.testing.assert_allclose(np.cos(scan.angles), np.cos(np.radians(scan.device_angles)), atol=1e-5)
        np.testing.assert_allclose(np.sin(scan.angles), -np.sin(np.radians(scan.device_angles)), atol=1e-5)
        np.testing.assert_array_equal(np.isnan(scan.ranges), scan.device_distances == 0)
        np.testing.assert_allclose(scan.ranges[scan.valid], scan.device_distances[scan.valid] / 1000, rtol=1e-6)
        assert scan.mode == "mode of the case"
    assert (scans[0].intensities is None) is (case.samples[0].quality is None)


@pytest.mark.parametrize("run", [1, 200])
def test_a_zero_offset_may_begin_behind_the_next_scan(run: int) -> None:
    """Where a part of the revolution in the making was told already, the rest of it keeps its offset."""
    packets = numbered(24 * 7 + 1, 960)
    assembler, scans = Assembler(stream_of(DENSE, sample_ns=float(SAMPLE_NS)), BAUD), list[Scan]()
    for begin in (0, *range(60, len(packets), run)):
        if begin == 60:
            assembler.set_zero_offset(30.0, behind=True)
        end = min(begin + run, len(packets)) if begin else 60
        scans += assembler.add(arrived(b"".join(packets[begin:end]), end - begin, round(on_time(end - 1))))
    assert [round(float(scan.device_angles[0])) for scan in scans] == [0, 0, 30, 30, 30, 30]


def test_what_follows_packets_that_were_left_midway_at_a_seam_begins_a_revolution() -> None:
    """As where sectors are wanted while a long read is taken: those that are left are discarded, up to a seam."""
    assembler, packets = Assembler(stream_of(DENSE, sample_ns=float(SAMPLE_NS)), BAUD), numbered(240, 960)
    runs = [
        arrived(b"".join(packets[begin:end]), end - begin, round(on_time(end - 1)))
        for begin, end in ((0, 72), (72, 144), (144, 240))
    ]
    assembler.add(runs[0])
    next(left := assembler.ends(runs[1]))
    del left
    assert [round(scan.device_distances[0]) // 40 for scan in assembler.add(runs[2])] == [144, 168, 192]


@pytest.mark.parametrize("gone", [None, 200], ids=["whole", "a packet gone"])
def test_a_stream_that_its_reader_ends_between_two_revolutions_of_a_read_delivers_no_more(gone: int | None) -> None:
    assembler = Assembler(stream_of(DENSE, sample_ns=float(SAMPLE_NS)), BAUD)
    packets = numbered(24 * 12, 960)
    known, rest = packets[:120], packets[120:gone] + packets[gone + 1 :] if gone else packets[120:]
    assembler.add(arrived(b"".join(known), len(known), round(on_time(119))))
    ready = assembler.ends(arrived(b"".join(rest), len(rest), round(on_time(len(packets) - 1))))
    before = assembler.stats.scans
    assert next(ready)
    delivered = assembler.stats.scans - before
    assembler.end()
    assert next(ready, None) is None
    counted = assembler.stats
    assert counted.scans - before == delivered
    assert counted.scan_packets + counted.discarded_packets == len(known) + len(rest)


# -------------------------------------------------------------------------------------------- what is read together


@pytest.mark.parametrize("chunk", [700, 4096, 40_000])
def test_packets_of_many_sizes_are_walked_only_by_the_parser(chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they begin is found once, and carried with them through the assembler and the decoder."""
    case = next(case for case in KINDS if case.truth.family == "ydlidar")
    link, events = open_stream(case), list[Packets]()
    for piece in cut_up(case.raw, chunk):
        link.receive_data(piece, 0)
        events += [event for event in link.events_received() if isinstance(event, Packets)]
    walks: list[int] = []

    def walk(data: bytes, at: int, size: int) -> int:
        walks.append(at)
        return equal_sizes(data, at, size)

    equal_sizes = ydlidar_formats.equal_sizes
    monkeypatch.setattr(ydlidar_formats, "equal_sizes", walk)
    assembler = Assembler(stream_of(case))
    scans = [scan for event in events for scan in assembler.add(event)]
    assert len(scans) == len(case.turns)
    assert walks == []


@pytest.mark.parametrize("made", [Assembler, Pipeline])
def test_unless_it_is_told_otherwise_the_wall_clock_is_that_of_the_stamps(
    made: type[Assembler] | type[Pipeline],
) -> None:
    raw = arrived(b"".join(numbered(60, 960)), 60, 10**9)
    assembler = made(stream_of(DENSE))
    steps = assembler.ends(raw) if isinstance(assembler, Assembler) else assembler.take(raw)
    scans = [scan for step in steps for scan in step]
    assert [scan.wall_stamp_ns for scan in scans] == [scan.stamp_ns for scan in scans] != []


@pytest.mark.parametrize(
    ("changes", "scans"),
    [
        ({}, 2),
        ({"broken": True}, 0),
        ({"moved": True}, 0),
        ({"marked": True}, 0),
        # A mark that ended no revolution has moved it.
        ({"seam": TURN // 4}, 0),
    ],
)
def test_only_revolutions_with_one_seam_are_decoded_together(changes: dict[str, Any], scans: int) -> None:
    assembler, packets = Assembler(stream_of(DENSE, sample_ns=float(SAMPLE_NS)), BAUD), numbered(110, 960)
    for number, packet in enumerate(packets[:60]):
        assembler.add(arrived(packet, 1, round(on_time(number))))
    event = arrived(b"".join(packets[60:]), 50, round(on_time(109)))
    before = assembler.stats.scan_packets
    first = Split(12, marked=False, broken=False, seam=0)
    second = first._replace(packet=36, **changes)
    assert len(assembler.add_block(event, packet_offsets(event.blocks), [first, second], 0, {})) == scans
    # It has changed nothing where it has made none.
    assert (assembler.stats.scan_packets > before) == bool(scans)
