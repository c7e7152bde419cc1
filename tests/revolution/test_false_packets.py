"""Noise that passes for a packet costs nothing but the packet in whose place it came."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.recording.stored_times import StoredTimes
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.scans.scan import Scan
from lidario.wire.formats import HEADING_MASK
from tests.support.cases import KINDS, Case, named
from tests.support.numbered import BAUD, DENSE, assemble, numbered, numbers, on_time
from tests.support.streams import in_one_run, stream_of

LEARNED = 20
"""Packets after which it is known how far the rotor turns from one to the next."""


def turned(case: Case) -> list[int]:
    """Where each packet of a golden stream begins, of which a turn has `full_turn`."""
    wire = case.make_format()
    return [int(each) & HEADING_MASK for each in wire.headings(in_one_run(wire, b"".join(case.packets)))]


def can_tell(case: Case) -> bool:
    """Whether its packets have a check value of eight bits, or hardly more, and are many in a revolution."""
    wire = case.make_format()
    if wire.shortest != wire.longest or wire.samples == 1:
        return False
    advances = np.diff(turned(case)) % wire.full_turn
    return bool(np.mean(advances) < wire.full_turn / 13 and len(case.packets) > 3 * LEARNED)


JUDGED = [case for case in KINDS if can_tell(case)]


def scans_of(case: Case, packets: dict[int, bytes], run: int) -> tuple[list[Scan], AssemblerStats]:
    """The scans of packets that came in their turn, so many at a time."""
    wire, assembler, scans = case.make_format(), Assembler(stream_of(case)), list[Scan]()
    packet_ns = case.byte_ns * wire.shortest
    for begin in range(0, len(case.packets), run):
        part = [packets[number] for number in range(begin, begin + run) if number in packets]
        if part:
            scans += assembler.add(in_one_run(wire, b"".join(part), round((begin + run) * packet_ns)))
    assembler.end()
    assert assembler.stats.unfinished_packets == assembler.stats.waiting_packets == 0
    return scans, assembler.stats


@pytest.mark.long
@pytest.mark.parametrize("case", JUDGED, ids=named)
@given(data=st.data())
def test_it_costs_nothing_else(case: Case, data: st.DataObject) -> None:
    wire, count = case.make_format(), len(case.packets)
    at, headings = data.draw(st.integers(LEARNED, count - 2), "its number"), turned(case)
    # Any other packet has a check value that holds. One a little ahead seems true, one a little behind to tremble.
    ahead = (np.array(headings) - headings[at - 1]) % wire.full_turn / wire.full_turn
    usual = float(np.median(np.diff(headings) % wire.full_turn)) / wire.full_turn
    far = np.flatnonzero((4 * usual < ahead) & (ahead < 0.96)).tolist()
    run = data.draw(st.sampled_from([1, 2, 7, count]), "packets at a time")
    packets = dict(enumerate(case.packets))
    false = packets | {at: case.packets[data.draw(st.sampled_from(far), "what is in its place")]}
    del packets[at]
    expected, before = scans_of(case, packets, run)
    found, stats = scans_of(case, false, run)
    assert stats == replace(before, false_packets=1)
    assert [scan.seq for scan in found] == [scan.seq for scan in expected]
    for scan, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(scan.device_angles, other.device_angles)
        np.testing.assert_array_equal(scan.device_distances, other.device_distances)
        assert scan.lost_packets == other.lost_packets


@pytest.mark.exhaustive("off", sample=[-2, 1, 4, 16, 64])
@pytest.mark.parametrize("size", [84, 100, 84 * 24])
@pytest.mark.parametrize("damaged", [(0, 1), (1, 2)])
def test_amid_damage_the_bytes_that_were_skipped_tell_where_it_belongs(
    off: int, size: int, damaged: tuple[int, int]
) -> None:
    """Of each four packets two are damaged, and of one that passes the angle is off by some times 4 degrees."""
    packets = numbered(24 * 6, 960)
    spoilt = {at: bytes(84) for at in range(LEARNED, 24 * 5) if at % 4 in damaged}
    false = {24 * 3 + 7: numbered(1, 960, 960 * 7 + 256 * off)[0]}
    data = b"".join([(false | spoilt).get(at, packet) for at, packet in enumerate(packets)])
    pipeline, scans = Pipeline(stream_of(DENSE), BAUD), list[Scan]()
    for begin in range(0, len(data), size):
        last = min(begin + size, len(data)) // 84 - 1
        scans += pipeline.receive(data[begin : begin + size], round(on_time(max(0, last))))
    pipeline.assembler.end()
    assert pipeline.stats.false_packets == 1
    assert len(scans) == 4
    for number in numbers(scans):
        packet = (number - 1) // 40
        assert packet not in spoilt.keys() | false.keys()
    assert pipeline.stats.lost_packets == len(spoilt) + 1


@pytest.mark.parametrize("text", [7, 29, 37, 80])
@pytest.mark.parametrize("packets", [1, 2, 3])
def test_a_text_within_packets_makes_none_behind_them_false(text: int, packets: int) -> None:
    """More was skipped there than the rotor turned. A text in one packet of each six, or in some in a row."""
    clean = numbered(24 * 8, 960)
    told = {at for at in range(LEARNED, 24 * 7) if at % 6 < packets}
    data = [packet[:50] + b"x" * text + packet[50:] if at in told else packet for at, packet in enumerate(clean)]
    pipeline = Pipeline(stream_of(DENSE), BAUD)
    pipeline.receive(b"".join(data), round(on_time(len(clean))))
    pipeline.assembler.end()
    assert (pipeline.stats.false_packets, pipeline.stats.lost_packets) == (0, len(told))


@pytest.mark.parametrize("spoilt", [0, 2])
def test_in_a_file_it_has_taken_its_time(spoilt: int) -> None:
    clean = numbered(24 * 5, 960)
    stamps = list[list[int]]()
    for false in ({}, {40: clean[52]}, {40: clean[52], 70: clean[60]}):
        packets = [false.get(at, packet) for at, packet in enumerate(clean)]
        for at in range(71, 71 + spoilt):
            packets[at] = packets[at][:-1] + bytes([packets[at][-1] ^ 1])
        stream = stream_of(DENSE)
        pipeline = Pipeline(stream, clock=StoredTimes(stream))
        stamps.append([scan.stamp_ns for scan in pipeline.receive(b"".join(packets))])
        assert pipeline.stats.false_packets == len(false)
    assert stamps[0] == stamps[1] == stamps[2]
    assert len(stamps[0]) == 3


def test_where_a_rotor_stands_amid_damage_none_is_false() -> None:
    """The bytes that were skipped make more than a turn."""
    stats, moving, still = AssemblerStats(), b"".join(numbered(30, 960)), numbered(1, 0, 960 * 30)[0]
    spoilt = still[:-1] + bytes([still[-1] ^ 1])
    pipeline = Pipeline(stream_of(DENSE), BAUD, stats=stats)
    for at, part in enumerate([moving + 7 * spoilt, still + 16 * spoilt, still + spoilt, still, still]):
        pipeline.receive(part, (at + 1) * 20_000_000)
    pipeline.assembler.end()
    assert (stats.false_packets, pipeline.link.stats.packets) == (0, 34)


def test_it_is_told_also_where_a_rotor_trembled_back_before() -> None:
    clean, stats = numbered(24 * 6, 960), AssemblerStats()
    trembling = [*clean[:25], *numbered(1, 0, 24 * 960 - 3), *clean[25:40], clean[52], *clean[41:]]
    assemble(trembling, stats=stats)
    assert (stats.false_packets, stats.lost_packets) == (1, 1)


def test_one_between_two_outages_is_not_false() -> None:
    """Almost a turn is missing before it and a few packets behind it: it seems to have fallen back, alone."""
    clean, stats = numbered(24 * 6, 960), AssemblerStats()
    assemble([*clean[:40], clean[62], *clean[68:]], stats=stats)
    assert (stats.false_packets, stats.lost_packets) == (0, 22 + 5)


def test_only_the_last_packet_waits() -> None:
    """A file comes in one read."""
    packets = numbered(24 * 4, 960)
    assert len(assemble([*packets[:-9], packets[-1]], run=1000)) == 2


def test_one_that_waits_at_the_end_tells_what_is_missing_before_it() -> None:
    packets, stats = numbered(24 * 2, 960), AssemblerStats()
    assembler = Assembler(stream_of(DENSE), stats=stats)
    for packet in [*packets[:-4], packets[-1]]:
        assembler.add(in_one_run(DENSE.make_format(), packet))
    assert stats.waiting_packets == 1
    assembler.end()
    assert (stats.lost_packets, stats.waiting_packets, stats.unfinished_packets) == (3, 0, 0)
