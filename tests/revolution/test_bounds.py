"""A revolution has a bound in bytes: what is told of its times comes from a device, a peer or a file."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import Any

import pytest

from benchmarks.floods.bytes import blob
from benchmarks.streams import KINDS as STEADY
from lidario.families.stream import LONGEST_REVOLUTION
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.revolution.partial import MOST_IN_A_PART
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.sectors import SectorAssembler
from lidario.revolution.together import joined
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets
from lidario.wire.formats import Headings
from tests.support.cases import CASES, KINDS, Case, named
from tests.support.streams import arrived, in_one_run, stream_of


def never_ending(case: Case) -> bytes:
    """A packet of that stream in the midst of a revolution; again and again it never ends one."""
    run = in_one_run(case.make_format(), case.raw, 0)
    offsets = packet_offsets(run.blocks)
    headings = [int(each) for each in case.make_format().headings(run)]
    full = case.make_format().full_turn
    middle = min(range(run.count), key=lambda number: abs(headings[number] - full // 2))
    return run.data[offsets[middle] : offsets[middle + 1]]


def fed(assembler: Assembler, lead: bytes, packet: bytes, total: int, wire: Any, *, together: int) -> int:
    """Feed a stream and then one packet again and again, at one time; return the most bytes that were held."""
    begun = in_one_run(wire, lead, 0)
    assembler.add(begun)
    stats, offsets = assembler.stats, packet_offsets(begun.blocks)
    # Packets of the stream itself that the revolution begins with may be shorter.
    discarded, first = stats.discarded_packets, stats.unfinished_packets
    shorter = first * len(packet) - (offsets[-1] - offsets[-1 - first])
    most = 0
    for _ in range(0, total, together * len(packet)):
        assembler.add(arrived(packet * together, together, 0))
        is_first = stats.discarded_packets == discarded
        most = max(most, stats.unfinished_packets * len(packet) - shorter * is_first)
    return most


@pytest.mark.long
@pytest.mark.exhaustive("case", sample=CASES[::5], full=CASES)
@pytest.mark.parametrize("sectors", [False, True], ids=["scans", "sectors"])
def test_a_revolution_whose_times_stand_still_is_given_up_by_its_bytes(case: Case, sectors: bool) -> None:
    stream = replace(stream_of(case), slowest_turn_s=0.2)
    assert stream.sample_ns > 0
    stats = AssemblerStats()
    assembler = SectorAssembler(stream, stats=stats)
    if sectors:
        assembler.divide([8], lambda *_: None)
    packet = never_ending(case)
    most = fed(assembler, case.raw, packet, 2 * stream.most_bytes, case.make_format(), together=8)
    assert stream.most_bytes // 4 < most <= stream.most_bytes
    assert stats.discarded_packets * len(packet) > stream.most_bytes
    # What comes then is a stream as any other.
    before = stats.scans
    assembler.add(in_one_run(case.make_format(), case.raw, 10**9))
    assert stats.scans > before


@pytest.mark.long
def test_what_it_takes_is_bounded_too() -> None:
    """One packet at a time, whatever is claimed: an hour for a revolution, ten picoseconds for a sample."""
    case = next(case for case in CASES if case.make_format().longest == 5)
    stream = replace(stream_of(case), slowest_turn_s=3600.0, sample_ns=0.01)
    assembler = Assembler(stream)
    packet = never_ending(case)
    tracemalloc.start()
    try:
        # It takes long to trace them all.
        part = fed(assembler, case.raw, packet, stream.most_bytes // 16, case.make_format(), together=1)
        assert tracemalloc.get_traced_memory()[1] * stream.most_bytes / part < 50e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("case", KINDS, ids=named)
def test_it_is_what_the_slowest_revolution_can_hold_twice(case: Case) -> None:
    stream = stream_of(case)
    wire = case.make_format()
    run = in_one_run(wire, case.raw, 0)
    bytes_a_sample = len(run.data) / wire.samples_in(run.blocks)
    slowest = stream.slowest_turn_s * 1e9 / stream.sample_ns
    assert stream.most_bytes >= min(2 * slowest, LONGEST_REVOLUTION) * bytes_a_sample
    # Whatever is claimed.
    most = replace(stream, sample_ns=0.0).most_bytes
    assert most == replace(stream, sample_ns=1e-3).most_bytes == replace(stream, slowest_turn_s=3600.0).most_bytes
    # A packet of one sample would be mostly head.
    assert stream.most_bytes <= most < 2 << 20


def test_few_of_many_packets_are_looked_at_in_one_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many come together, other tasks run between two steps."""
    case = next(case for case in CASES if case.make_format().longest == 5)
    run, stream, looked = in_one_run(case.make_format(), case.raw, 10**9), stream_of(case), list[int]()
    headings = stream.format.headings

    def count(packets: Packets) -> Headings:
        looked.append(packets.count)
        return headings(packets)

    monkeypatch.setattr(stream.format, "headings", count)
    scans = [scan for step in Pipeline(stream).take(run) for scan in step]
    assert len(scans) > 1
    # A revolution, at most.
    assert max(looked) < 4000 < run.count


def test_each_part_is_a_step_also_where_no_revolution_ends() -> None:
    """As of a peer that floods: all packets have one angle."""
    pipeline = Pipeline(STEADY["0x85 dense"].stream())
    pipeline.link.receive_data(blob("endless", 84 * 3 * MOST_IN_A_PART), 1)
    packets = joined([event for event in pipeline.link.events_received() if isinstance(event, Packets)])
    assert list(pipeline.take(packets)) == [[], [], []]
