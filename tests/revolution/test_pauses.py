"""A line that brings nothing for a while, or a program that does not read: what is missing is told, and no more.

Where all of it comes in pieces, nothing is missing. Where nobody reads, the line keeps what came first and drops
the rest. What it has kept is read behind the pause, together with what comes behind the gap. So the last packets
before a gap are dated late by all of it, and no time lies where packets are missing.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import accumulate, pairwise

import pytest

from benchmarks.streams import KINDS, capture
from lidario.revolution.pipeline import Pipeline
from lidario.scans.scan import Scan
from lidario.wire.envelope import DESCRIPTOR_SIZE

SECONDS = 3.0
POLL_S = 0.005
BLOCKED_SECONDS = 4.5
HOLDS = 4095
"""Bytes that the kernel keeps of a terminal."""
TURN_S = {"4ROS points": 1 / 7}
ONE_A_PARSER = ["0x81 nodes", "0x83 HQ", "0x84 ultra", "0x85 dense", "4ROS points"]
SLOW_ENOUGH = [name for name in KINDS if name not in ("0x81 nodes", "0x83 HQ")]
"""These two would take 1.6 and 2.6 megabaud for 32000 samples a second."""
Read = tuple[float, float]
"""Up to where in the stream it reads, in seconds of the stream, and when."""


def reads_of(begin: float, *pauses: tuple[float, float]) -> list[Read]:
    """Reads at an even pace, but for pauses; behind each comes a piece of so many seconds, soon all the rest."""
    times = [number * POLL_S for number in range(1, round(SECONDS / POLL_S) - 1)]
    reads = [(at, at) for at in times if at <= begin]
    upto, now = reads[-1]
    for pause, piece in pauses:
        upto, now = upto + piece, now + pause
        reads.append((upto, now))
    if pauses:
        reads.append((now + 2 * POLL_S, now + 2 * POLL_S))
    return reads + [(at, at) for at in times if at > reads[-1][1]]


def scans_of(
    name: str, reads: Sequence[Read], *, together: bool = False, seconds: float = SECONDS, holds: int = 1 << 30
) -> tuple[list[Scan], Pipeline]:
    """The scans of a stream that is read so, and what made them; a read finds so many bytes at most."""
    raw, pipeline, scans = capture(KINDS[name], seconds), Pipeline(KINDS[name].stream()), list[Scan]()
    a_second = (len(raw) - DESCRIPTOR_SIZE) / seconds
    ends = [DESCRIPTOR_SIZE + round(upto * a_second) for upto, _ in reads]
    pieces = [
        (raw[begin : min(end, begin + holds)], round(now * 1e9))
        for (begin, end), (_, now) in zip(pairwise([DESCRIPTOR_SIZE, *ends]), reads, strict=True)
    ]
    if together:
        # A second at a time, with the times of its reads.
        for first in range(0, len(pieces), 200):
            some, size, arrivals = pieces[first : first + 200], 0, []
            for data, now in some:
                size += len(data)
                arrivals.append((size, now))
            scans += pipeline.receive(b"".join([data for data, _ in some]), some[-1][1], arrivals[:-1])
    else:
        for data, now in pieces:
            scans += pipeline.receive(data, now)
    return scans, pipeline


@cache
def clean(name: str) -> list[Scan]:
    return scans_of(name, reads_of(0.5))[0]


def once(*turns: float) -> list[list[tuple[float, float]]]:
    """Pauses of so many turns, each with a piece behind it, soon all the rest."""
    return [[(each, piece)] for each in turns for piece in (0.04, 0.13)]


AGAIN = [
    [(0.54, 0.01), (0.97, 0.36), (1.17, 1.62)],
    [(0.6, 0.2), (0.6, 0.2), (0.5, 0.4)],
    [(1.1, 0.2), (0.5, 0.3), (0.5, 0.9)],
    [(2.0, 0.1), (0.6, 1.0), (0.6, 1.0), (0.6, 1.0)],
    [(0.45, 0.1), (0.45, 0.1), (0.45, 0.1), (0.45, 0.1)],
]
"""As the terminal of a device that waits for its reader, on a busy machine: it pauses before it has caught up."""


@pytest.mark.exhaustive("name", sample=ONE_A_PARSER, full=list(KINDS))
@pytest.mark.exhaustive("phase", sample=[0.35], full=[0.05, 0.15, 0.35, 0.55, 0.65, 0.75, 0.95])
@pytest.mark.exhaustive(
    "pauses", sample=[*once(0.9, 1.1, 1.3), *AGAIN], full=[*once(0.7, 0.8, 0.9, 1.0, 1.1, 1.3, 1.9, 2.0), *AGAIN]
)
def test_pauses_cost_nothing(name: str, phase: float, pauses: list[tuple[float, float]]) -> None:
    """Each pause and the piece behind it, in turns."""
    turn_s, expected = TURN_S.get(name, 0.1), clean(name)
    reads = reads_of(1.2 + phase * turn_s, *[(turn_s * one, turn_s * other) for one, other in pauses])
    for together in (False, True):
        scans, pipeline = scans_of(name, reads, together=together)
        stats = pipeline.stats
        assert (stats.missed_scans, stats.broken_scans, stats.lost_packets, stats.waiting_packets) == (0, 0, 0, 0)
        assert [scan.seq for scan in scans] == [scan.seq for scan in expected]
        assert [len(scan) for scan in scans] == [len(scan) for scan in expected]
        off = max(abs(here.stamp_ns - there.stamp_ns) for here, there in zip(scans, expected, strict=True))
        assert off < 0.1e9 * turn_s


@pytest.mark.exhaustive("name", sample=ONE_A_PARSER, full=list(KINDS))
@pytest.mark.exhaustive("times", sample=[1.5], full=[1.5, 3, 13, 1000])
def test_what_comes_faster_than_any_rotor_turns_is_delivered(name: str, times: float) -> None:
    """As where a file is written to a port. Its times tell nothing, and so nothing is early."""
    scans, pipeline = scans_of(name, [(upto, now / times) for upto, now in reads_of(0.5)])
    assert [len(scan) for scan in scans] == [len(scan) for scan in clean(name)]
    assert pipeline.stats.missed_scans == pipeline.stats.broken_scans == 0


class Outage:
    """A stream of which nothing came for almost two turns, and then a piece, which waits."""

    def __init__(self, name: str) -> None:
        self.turn_s = TURN_S.get(name, 0.1)
        self._raw, self.pipeline = capture(KINDS[name], SECONDS), Pipeline(KINDS[name].stream())
        self._a_second = (len(self._raw) - DESCRIPTOR_SIZE) / SECONDS
        self.now = 0.0
        while self.now < 1.2:
            self.pipeline.receive(self.come(POLL_S), round(self.now * 1e9))

    def come(self, seconds: float) -> bytes:
        """What comes in so many seconds."""
        begin, end = (DESCRIPTOR_SIZE + round(at * self._a_second) for at in (self.now, self.now + seconds))
        self.now += seconds
        return self._raw[begin:end]

    def late(self) -> Iterator[list[Scan]]:
        """What comes before and behind the outage, looked at together, in steps."""
        before, before_s = self.come(self.turn_s), self.now
        self.now += 1.95 * self.turn_s
        data = before + self.come(1.1 * self.turn_s)
        return self.pipeline.steps(data, round(self.now * 1e9), [(len(before), round(before_s * 1e9))])


@pytest.mark.parametrize("name", ["0x85 dense", "4ROS points"])
def test_packets_that_wait_when_the_stream_ends_are_judged_as_they_came(name: str) -> None:
    cut, whole = Outage(name), Outage(name)
    for each in cut, whole:
        assert [scan for scans in each.late() for scan in scans]
        assert each.pipeline.stats.waiting_packets > 0
    cut.pipeline.assembler.end()
    while whole.pipeline.stats.waiting_packets:
        whole.pipeline.receive(whole.come(POLL_S), round(whole.now * 1e9))
    stats = cut.pipeline.stats
    assert 0 < stats.missed_scans <= whole.pipeline.stats.missed_scans
    assert 0 < stats.lost_packets <= whole.pipeline.stats.lost_packets
    assert (stats.waiting_packets, stats.unfinished_packets) == (0, 0)
    assert stats.scan_packets + stats.discarded_packets == cut.pipeline.link.stats.packets


@pytest.mark.parametrize("closed", [True, False])
def test_nothing_is_told_of_those_that_wait_behind_packets_that_were_not_looked_at(closed: bool) -> None:
    """A stream is ended between two steps of the work at what came before."""
    stream = Outage("4ROS points")
    steps = stream.late()
    while not next(steps):
        pass
    if closed:
        # Garbage.
        steps = iter(())
    assert stream.pipeline.stats.waiting_packets > 0
    assert not [*stream.pipeline.assembler.end(), *steps]
    stats = stream.pipeline.stats
    assert (stats.waiting_packets, stats.unfinished_packets) == (0, 0)
    assert (stats.lost_packets, stats.missed_scans) == (0, 0)
    assert stats.scan_packets + stats.discarded_packets == stream.pipeline.link.stats.packets


def read_times(blocks: Sequence[tuple[float, float]] = ()) -> list[Read]:
    """Every few milliseconds, but not in the blocks: when each begins, and how long it lasts."""
    times, now = list[Read](), 0.0
    waiting = list(blocks)
    while now < BLOCKED_SECONDS - 0.01:
        now += waiting.pop(0)[1] if waiting and now >= waiting[0][0] else POLL_S
        times.append((now, now))
    return times


def blocked(name: str, blocks: Sequence[tuple[float, float]] = ()) -> tuple[list[Scan], Pipeline]:
    """The scans of a stream whose reader is blocked so, and what made them."""
    return scans_of(name, read_times(blocks), seconds=BLOCKED_SECONDS, holds=HOLDS)


@cache
def unblocked(name: str) -> tuple[list[Scan], Pipeline]:
    return blocked(name)


@pytest.mark.exhaustive("name", sample=ONE_A_PARSER[2:], full=SLOW_ENOUGH)
@pytest.mark.exhaustive("block_s", sample=[0.2, 0.8], full=[0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.0])
@pytest.mark.exhaustive("phase", sample=[0.0, 0.75], full=[0.0, 0.5, 0.75])
@pytest.mark.exhaustive("pause_s", sample=[None, 0.06], full=[None, 0.06, 0.11, 0.22])
def test_a_blocked_reader_is_told_all_that_is_missing(
    name: str, block_s: float, phase: float, pause_s: float | None
) -> None:
    """Blocked once, or twice with a short pause between, at any place of a revolution."""
    first = 1.2 + phase * TURN_S.get(name, 0.1)
    blocks = [(first, block_s)] if pause_s is None else [(first, block_s), (first + block_s + pause_s, block_s)]
    whole, sent = unblocked(name)
    scans, pipeline = blocked(name, blocks)
    gone = sent.link.stats.packets - pipeline.link.stats.packets
    assert pipeline.stats.lost_packets == pytest.approx(gone, abs=3, rel=0.01)
    assert len(scans) + pipeline.stats.missed_scans == len(whole)
    for scan in scans[-5:]:
        assert abs(scan.stamp_ns - whole[scan.seq].stamp_ns) < 0.1e9 * TURN_S.get(name, 0.1)


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
