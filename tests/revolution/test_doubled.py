"""A packet that comes twice, or a few times, is dropped and counted, and costs nothing else."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.families.base import Known
from lidario.recording.offline import OfflineDecoder
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.revolution.doubled import MOST_ALIKE, without
from lidario.scans.scan import Scan
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from tests.support.cases import KINDS, Case
from tests.support.streams import in_one_run, stream_of

WITH_A_CHECK = [case for case in KINDS if case.response_type != 0x81 or not case.name.startswith("rplidar")]
NODES = next(case for case in KINDS if case.name == "rplidar_32k_81")


def scans_of(case: Case, packets: list[bytes], ends_ns: list[int], run: int) -> tuple[list[Scan], AssemblerStats]:
    """The scans of packets of which so many at a time are handed over."""
    wire, assembler, scans = case.make_format(), Assembler(stream_of(case)), list[Scan]()
    for at in range(0, len(packets), run):
        part = packets[at : at + run]
        scans += assembler.add(in_one_run(wire, b"".join(part), ends_ns[at + len(part) - 1]))
    return scans, assembler.stats


def pace(case: Case) -> list[int]:
    """When each packet of a golden stream has come."""
    return [round(each * case.byte_ns) for each in np.cumsum([len(packet) for packet in case.packets])]


def some(case: Case) -> list[bytes]:
    """The packets of a golden stream up to its third seam or a little more."""
    return list(case.packets[: case.turns[2][0].packet + 2])


@cache
def undisturbed(case: Case) -> tuple[list[Scan], AssemblerStats]:
    """The scans of these packets, which come one by one."""
    return scans_of(case, some(case), pace(case), 1)


@pytest.mark.long
@pytest.mark.exhaustive("case", sample=WITH_A_CHECK)
@given(data=st.data())
def test_it_costs_nothing(case: Case, data: st.DataObject) -> None:
    single, ends_ns = some(case), pace(case)
    run = data.draw(st.sampled_from([1, 3, 17, len(single)]), "packets at a time")
    every = data.draw(st.integers(1, 40), "one in so many comes again")
    first = data.draw(st.integers(0, every - 1), "the first of them")
    most = data.draw(st.integers(2, MOST_ALIKE), "so often")
    packets, times, twice = list[bytes](), list[int](), 0
    for number, (packet, end_ns) in enumerate(zip(single, ends_ns, strict=False)):
        copies = most if number % every == first else 1
        twice += copies - 1
        packets += [packet] * copies
        times += [end_ns] * copies
    plain, before = undisturbed(case)
    found, stats = scans_of(case, packets, times, 1)
    assert stats == replace(before, doubled_packets=twice)
    assert [scan.stamp_ns for scan in found] == [scan.stamp_ns for scan in plain]
    # However many came together, which of them have a later stamp.
    together, stats = scans_of(case, packets, times, run)
    assert (stats.doubled_packets, stats.scans, stats.lost_packets) == (twice, before.scans, before.lost_packets)
    for scan, other in zip(together, plain, strict=True):
        np.testing.assert_array_equal(scan.device_angles, other.device_angles)
        np.testing.assert_array_equal(scan.device_distances, other.device_distances)
        assert scan.seq == other.seq


@pytest.mark.exhaustive("case", sample=WITH_A_CHECK)
def test_it_takes_no_time_in_a_file(case: Case) -> None:
    """There the samples are counted to tell the time, and those that came twice were measured once."""

    def found(packets: list[bytes]) -> tuple[list[Scan], AssemblerStats]:
        raw = b"".join([case.told, case.descriptor, *packets])
        decoder = OfflineDecoder(raw, Known(case.truth.family, sample_us=case.sample_us))
        # In as many blocks as a long file has.
        parts = [raw[at : at + 700] for at in range(decoder.begin, len(raw), 700)]
        return list(decoder.scans_of(parts)), decoder.pipeline.stats

    packets = list(case.packets)
    plain, before = found(packets)
    doubled = [
        packet
        for number, packet in enumerate(packets)
        for packet in [packet] * (2 + number % 2 if number % 7 == 3 else 1)
    ]
    scans, stats = found(doubled)
    assert stats == replace(before, doubled_packets=len(doubled) - len(packets))
    assert [(scan.seq, len(scan)) for scan in scans] == [(scan.seq, len(scan)) for scan in plain]
    for scan, other in zip(scans, plain, strict=True):
        # Other blocks are rounded elsewhere.
        assert scan.stamp_ns == pytest.approx(other.stamp_ns, abs=10)


@pytest.mark.exhaustive("case", sample=WITH_A_CHECK)
def test_of_many_that_are_alike_only_a_few_are_dropped(case: Case) -> None:
    """Then the rotor stands still, and nothing is missing."""
    packets = [case.packets[0], *[case.packets[1]] * 40, case.packets[2]]
    for run in (1, 2, 5):
        wire, assembler = case.make_format(), Assembler(stream_of(case))
        for at in range(0, len(packets), run):
            assembler.add(in_one_run(wire, b"".join(packets[at : at + run])))
        assembler.end()
        dropped = assembler.stats.doubled_packets
        assert (dropped, assembler.stats.discarded_packets) == (3, len(packets) - 3), run


def test_two_alike_that_may_both_be_true_stay() -> None:
    """A node is one sample: where the rotor is slow, the next one may be the same."""
    assembler = Assembler(stream_of(NODES))
    assembler.add(in_one_run(NODES.make_format(), NODES.packets[0] * 2))
    assert (assembler.stats.doubled_packets, assembler.stats.unfinished_packets) == (0, 2)


def test_the_times_of_the_others_stay() -> None:
    found = Packets(
        b"aabbccccdd",
        (Block(2, 2), Block(4, 1), Block(2, 1)),
        ((1, 10), (2, 20), (3, 30), (4, 40)),
        ((0, 7), (2, 3)),
    )
    left = without(found, [1, 2])
    assert left == Packets(b"aadd", (Block(2, 2),), ((1, 10), (2, 40)), ((0, 7), (1, 3)))
    assert without(found, [1, 2], as_noise=True).skips == ((0, 7), (1, 3 + 2 + 4))


@pytest.mark.exhaustive("case", sample=WITH_A_CHECK)
def test_one_that_comes_again_a_revolution_later_is_another_one(case: Case) -> None:
    wire, assembler = case.make_format(), Assembler(stream_of(case))
    assembler.add(in_one_run(wire, case.packets[0]))
    assembler.add(in_one_run(wire, case.packets[0], 30_000_000))
    assert assembler.stats.doubled_packets == 0
    # A piece of the line that came twice is rarely one packet: there is a rest of another one between the two.
    assembler.add(in_one_run(wire, case.packets[1], 31_000_000))
    assembler.add(replace(in_one_run(wire, case.packets[1], 31_000_000), skips=((0, 17),)))
    assert assembler.stats.doubled_packets == 1
