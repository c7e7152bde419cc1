"""A line that brings nothing for about a turn, and then all of it in pieces: nothing is missing or told as that."""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import pytest

from benchmarks.streams import KINDS, capture
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.scan import Scan
from lidario.wire.envelope import DESCRIPTOR_SIZE

SECONDS = 3.0
POLL_S = 0.005
TURN_S = {"4ROS points": 1 / 7}
ONE_A_PARSER = ["0x81 nodes", "0x83 HQ", "0x84 ultra", "0x85 dense", "4ROS points"]
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


def scans_of(name: str, reads: Sequence[Read], *, together: bool = False) -> tuple[list[Scan], AssemblerStats]:
    raw, pipeline, scans = capture(KINDS[name], SECONDS), Pipeline(KINDS[name].stream()), list[Scan]()
    a_second = (len(raw) - DESCRIPTOR_SIZE) / SECONDS
    ends = [DESCRIPTOR_SIZE + round(upto * a_second) for upto, _ in reads]
    pieces = [
        (raw[begin:end], round(now * 1e9))
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
    return scans, pipeline.stats


@cache
def clean(name: str) -> list[Scan]:
    return scans_of(name, reads_of(0.5))[0]


@pytest.mark.exhaustive("name", sample=ONE_A_PARSER, full=list(KINDS))
@pytest.mark.exhaustive("turns", sample=[0.9, 1.1, 1.3], full=[0.7, 0.8, 0.9, 1.0, 1.1, 1.3, 1.9, 2.0])
@pytest.mark.exhaustive("phase", sample=[0.35, 0.55], full=[0.05, 0.15, 0.35, 0.55, 0.75, 0.95])
@pytest.mark.parametrize("piece_s", [0.004, 0.013])
def test_a_pause_of_a_turn_costs_nothing(name: str, turns: float, phase: float, piece_s: float) -> None:
    turn_s = TURN_S.get(name, 0.1)
    costs_nothing(name, reads_of(1.2 + phase * turn_s, (turns * turn_s, piece_s)))


@pytest.mark.exhaustive("name", sample=ONE_A_PARSER, full=list(KINDS))
@pytest.mark.exhaustive("phase", sample=[0.35], full=[0.05, 0.35, 0.65, 0.95])
@pytest.mark.parametrize(
    "pauses",
    [
        [(0.54, 0.01), (0.97, 0.36), (1.17, 1.62)],
        [(0.6, 0.2), (0.6, 0.2), (0.5, 0.4)],
        [(1.1, 0.2), (0.5, 0.3), (0.5, 0.9)],
        [(2.0, 0.1), (0.6, 1.0), (0.6, 1.0), (0.6, 1.0)],
        [(0.45, 0.1), (0.45, 0.1), (0.45, 0.1), (0.45, 0.1)],
    ],
)
def test_nor_does_one_that_pauses_again_before_it_has_caught_up(
    name: str, phase: float, pauses: list[tuple[float, float]]
) -> None:
    """As the terminal of a device that waits for its reader, on a machine that is busy; in turns."""
    turn_s = TURN_S.get(name, 0.1)
    costs_nothing(name, reads_of(1.2 + phase * turn_s, *[(turn_s * one, turn_s * other) for one, other in pauses]))


def costs_nothing(name: str, reads: Sequence[Read]) -> None:
    turn_s, expected = TURN_S.get(name, 0.1), clean(name)
    for together in (False, True):
        scans, stats = scans_of(name, reads, together=together)
        assert (stats.missed_scans, stats.broken_scans, stats.lost_packets, stats.waiting_packets) == (0, 0, 0, 0)
        assert [scan.seq for scan in scans] == [scan.seq for scan in expected]
        assert [len(scan) for scan in scans] == [len(scan) for scan in expected]
        off = max(abs(here.stamp_ns - there.stamp_ns) for here, there in zip(scans, expected, strict=True))
        assert off < 0.1e9 * turn_s


@pytest.mark.parametrize("name", ["0x85 dense", "4ROS points"])
def test_packets_that_wait_when_the_stream_ends_are_counted(name: str) -> None:
    turn_s = TURN_S.get(name, 0.1)
    raw, pipeline = capture(KINDS[name], SECONDS), Pipeline(KINDS[name].stream())
    a_second = (len(raw) - DESCRIPTOR_SIZE) / SECONDS
    place, now = DESCRIPTOR_SIZE, 0.0
    while now < 1.2:
        now += POLL_S
        end = DESCRIPTOR_SIZE + round(now * a_second)
        pipeline.receive(raw[place:end], round(now * 1e9))
        place = end
    assert pipeline.stats.waiting_packets == 0
    pipeline.receive(raw[place : place + round(0.01 * a_second)], round((now + turn_s) * 1e9))
    assert pipeline.stats.waiting_packets > 0
    pipeline.end()
    stats = pipeline.stats
    assert (stats.waiting_packets, stats.unfinished_packets) == (0, 0)
    assert stats.scan_packets + stats.discarded_packets == pipeline.link.stats.packets
