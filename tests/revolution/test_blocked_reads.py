"""Nobody reads for a while: the line keeps what came first and drops the rest, and what is missing is told in full.

What the line has kept is read behind the pause, together with what comes behind the gap. So the last packets before
a gap are dated late by all of it, and no time lies where packets are missing.
"""

import struct
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import accumulate, pairwise

import pytest

from benchmarks.streams import KINDS, capture
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.scan import Scan
from lidario.wire.envelope import DESCRIPTOR_SIZE

SECONDS = 4.5
HOLDS = 4095
"""Bytes that the kernel keeps of a terminal."""
POLL_S = 0.005
FIRST_S = 1.2
ONE_A_PARSER = ["0x84 ultra", "0x85 dense", "4ROS points"]
SLOW_ENOUGH = [name for name in KINDS if name not in ("0x81 nodes", "0x83 HQ")]
"""These two would take 1.6 and 2.6 megabaud for 32000 samples a second."""
REVOLUTION_S = {"4ROS points": 1 / 7}


def read_at(name: str, reads: Sequence[float]) -> tuple[list[Scan], AssemblerStats, int]:
    """Scans, counters and packets of a stream that is read at such times, in seconds from its beginning."""
    raw, pipeline, scans = capture(KINDS[name], SECONDS), Pipeline(KINDS[name].stream()), list[Scan]()
    a_second = (len(raw) - DESCRIPTOR_SIZE) / SECONDS
    for before, now in pairwise((0.0, *reads)):
        begin, end = (DESCRIPTOR_SIZE + round(at * a_second) for at in (before, now))
        scans += pipeline.receive(raw[begin : min(end, begin + HOLDS)], round(now * 1e9))
    return scans, pipeline.stats, pipeline.link.stats.packets


def read_times(blocks: Sequence[tuple[float, float]] = ()) -> list[float]:
    """Every few milliseconds, but not in the blocks: when each begins, and how long it lasts."""
    times, now = list[float](), 0.0
    waiting = list(blocks)
    while now < SECONDS - 0.01:
        now += waiting.pop(0)[1] if waiting and now >= waiting[0][0] else POLL_S
        times.append(now)
    return times


@cache
def undamaged(name: str) -> tuple[list[Scan], AssemblerStats, int]:
    return read_at(name, read_times())


@pytest.mark.exhaustive("name", sample=ONE_A_PARSER, full=SLOW_ENOUGH)
@pytest.mark.exhaustive("block_s", sample=[0.2], full=[0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.0])
@pytest.mark.exhaustive("phase", sample=[0.75], full=[0.0, 0.5, 0.75])
@pytest.mark.exhaustive("pause_s", sample=[None, 0.06], full=[None, 0.06, 0.11, 0.22])
def test_a_blocked_reader_is_told_all_that_is_missing(
    name: str, block_s: float, phase: float, pause_s: float | None
) -> None:
    """Blocked once, or twice with a short pause between, at any place of a revolution."""
    first = FIRST_S + phase * REVOLUTION_S.get(name, 0.1)
    blocks = [(first, block_s)] if pause_s is None else [(first, block_s), (first + block_s + pause_s, block_s)]
    clean, _, sent = undamaged(name)
    scans, stats, packets = read_at(name, read_times(blocks))
    assert stats.lost_packets == pytest.approx(sent - packets, abs=3, rel=0.01)
    assert len(scans) + stats.missed_scans == len(clean)
    for scan in scans[-5:]:
        assert abs(scan.stamp_ns - clean[scan.seq].stamp_ns) < 0.1e9 * REVOLUTION_S.get(name, 0.1)


def test_reads_of_several_revolutions_are_dated_alike_behind_a_rotor_that_stood() -> None:
    """Read one by one, or handed over together with their times: nothing is missing, and stamps are the same."""
    down, up = ([55 * at / nodes for at in range(nodes)] for nodes in (1500, 400))
    steps = [*[55.0] * 3000, *down[::-1], *[0.0] * 2500, *up, *[55.0] * 5000]
    angles = [round(at) % 23040 for at in accumulate(steps)]
    begins = [after < before for before, after in pairwise([0, *angles])]
    nodes = zip(begins, angles, strict=True)
    raw = b"".join([struct.pack("<BHH", 1 if begin else 2, angle << 1 | 1, 4000) for begin, angle in nodes])
    reads = [(end, end // 5 * 200_000) for end in range(4096, len(raw), 4096)]
    told = list[tuple[int, int, list[int]]]()
    # What it turned when a revolution ended last, tells nothing of a read behind its rest.
    for together in (1, 7):
        pipeline = Pipeline(replace(KINDS["0x81 nodes"].stream(), sample_ns=200_000.0))
        scans, begin = list[Scan](), 0
        for at in range(0, len(reads), together):
            *arrivals, (end, now) = [(end - begin, at_ns) for end, at_ns in reads[at : at + together]]
            scans += pipeline.receive(raw[begin : begin + end], now, arrivals)
            begin += end
        told.append((pipeline.stats.lost_packets, pipeline.stats.missed_scans, [scan.stamp_ns for scan in scans]))
    assert told[0] == told[1]
    assert told[0][:2] == (0, 0)
