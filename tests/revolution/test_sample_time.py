"""What a sample takes: told, and measured where that cannot be. Times are made up here, in nanoseconds."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pytest

from benchmarks.floods.bytes import blob
from benchmarks.streams import KINDS, capture
from lidario.families.rplidar.decode import DenseDecoder
from lidario.families.spans import Heads
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.sample_time import SampleTime
from lidario.revolution.sectors import SectorAssembler
from lidario.scans.scan import Scan
from lidario.wire.envelope import DESCRIPTOR_SIZE
from lidario.wire.events import Packets
from tests.support.cases import CASES, Case
from tests.support.streams import in_one_run, stream_of

MS = 1_000_000
TOLD_NS = 100_000.0
TURN = 1000
"""Samples of a revolution, and by what is told 100 ms."""


def after(times_ms: Iterable[float], told_ns: float = TOLD_NS) -> SampleTime:
    """A revolution came at each of these times."""
    time = SampleTime(told_ns)
    for at_ms in times_ms:
        time.add(TURN, round(at_ms * MS))
    return time


@pytest.mark.parametrize("factor", [0.95, 1.0, 1.05])
def test_what_is_nearly_right_is_believed(factor: float) -> None:
    time = after(100 * factor * number for number in range(200))
    assert (time.ns, time.take_note()) == (TOLD_NS, "")


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.25, 4.0])
def test_what_is_wrong_is_measured_and_told(factor: float) -> None:
    time = after(100 * factor * number for number in range(200))
    assert time.ns == pytest.approx(TOLD_NS * factor)
    note = time.take_note()
    assert note == f"the device tells 100 µs a sample, and takes {100 * factor:.4g}: what is measured counts"
    assert time.take_note() == ""


def test_several_revolutions_in_each_read() -> None:
    assert after(200 * (number // 5 * 5) for number in range(200)).ns == pytest.approx(2 * TOLD_NS)
    assert after(100 * (number // 5 * 5) for number in range(200)).ns == TOLD_NS


def test_a_file_that_comes_at_once_tells_nothing() -> None:
    assert after([7.0] * 500).ns == TOLD_NS


def test_a_program_that_blocks_again_and_again_loses_revolutions_and_says_nothing_of_the_time() -> None:
    times = [100 * number + 700 * (number // 12) for number in range(200)]
    assert after(times).ns == TOLD_NS


@pytest.mark.parametrize("stall_ms", [150, 250, 400, 700])
def test_a_line_that_stalls_again_and_again_is_none(stall_ms: int) -> None:
    """Once a second everything waits, and then comes at once."""
    for phase in range(0, 100, 20):
        seconds = [divmod(100 * number + phase, 1000) for number in range(200)]
        assert after(1000 * second + max(at_ms, stall_ms) for second, at_ms in seconds).ns == TOLD_NS, phase


def test_it_counts_anew_where_nobody_knows_what_is_missing() -> None:
    time = SampleTime(TOLD_NS)
    for number in range(100):
        if number % 10 == 0:
            time.restart()
        time.add(TURN, 200 * MS * number)
    assert time.ns == TOLD_NS


def test_where_nothing_is_told_it_is_measured_in_two_windows() -> None:
    assert after((100 * number for number in range(40)), told_ns=0.0).ns == 0.0
    time = after((100 * number for number in range(50)), told_ns=0.0)
    assert time.ns == pytest.approx(TOLD_NS)
    assert time.take_note() == ""
    assert SampleTime(0.0, timed=False).ns == 0.0


RATES = (10_000.0, 9000.0, 8000.0, 4000.0)


@pytest.mark.parametrize("rate", [*RATES, 9300.0, 8950.0, 8300.0, 3900.0])
@pytest.mark.parametrize("late_ms", [0, 10])
def test_one_of_several_rates_is_found_in_one_window(rate: float, late_ms: int) -> None:
    """Each read comes late by chance."""
    time, random = SampleTime(0.0, [1e9 / each for each in RATES]), np.random.default_rng(1)
    for number in range(24):
        time.add(TURN, round((1000 * number * TURN / rate + random.uniform(0, late_ms)) * MS))
    assert time.ns == 1e9 / min(RATES, key=lambda each: abs(each - rate))
    assert time.take_note() == ""


def test_a_rate_that_is_none_of_several_is_measured() -> None:
    time = SampleTime(0.0, [1e9 / each for each in RATES])
    for number in range(60):
        time.add(TURN, round(1000 * number * TURN / 6000 * MS))
    assert time.ns == pytest.approx(1e9 / 6000)


@pytest.mark.parametrize(
    ("hertz", "rate"), [(7.0, 9000.0), (7.1, 9000.0), (6.2, 8000.0), (3.2, 4000.0), (14.0, 0.0)]
)
def test_until_then_the_speed_tells_it_that_packets_tell(hertz: float, rate: float) -> None:
    time = SampleTime(0.0, [1e9 / each for each in RATES])
    time.suppose(9000 / 7.0, 60 * hertz)
    assert time.ns == (1e9 / rate if rate else 0.0)
    time.suppose(9000 / 7.0, 60 * 3.2)
    assert time.ns == (1e9 / rate if rate else 1e9 / 4000)
    # What is measured has the last word.
    for number in range(21):
        time.add(TURN, round(1000 * number * TURN / 8000 * MS))
    assert (time.ns, time.take_note()) == (1e9 / 8000, "")
    time.suppose(9000 / 7.0, 60 * 7.0)
    assert time.ns == 1e9 / 8000


def test_a_speed_that_is_none_tells_nothing() -> None:
    for samples, rpm in ((1285.0, math.nan), (1285.0, 0.0), (0.0, 420.0)):
        time = SampleTime(0.0, [1e9 / each for each in RATES])
        time.suppose(samples, rpm)
        assert time.ns == 0.0
    time = SampleTime(TOLD_NS)
    time.suppose(1285.0, 420.0)
    assert time.ns == TOLD_NS


def test_outages_choose_no_other_rate() -> None:
    """Of 20 revolutions three are missing: by the mean it would be the next lower rate."""
    time, missing = SampleTime(0.0, [1e9 / each for each in RATES]), 0
    for number in range(21):
        missing += number in (5, 9, 14)
        time.add(TURN, round(1000 * (number + missing) * TURN / 9000 * MS))
    assert time.ns == 0.0


@pytest.mark.parametrize("name", KINDS)
def test_what_came_at_one_moment_tells_no_time(name: str) -> None:
    """Of a device that tells none: the samples are there, and when they were measured is not known."""
    kind = KINDS[name]
    pipeline = Pipeline(replace(kind.stream(), sample_ns=0.0))
    scans = pipeline.receive(capture(kind, 2.0)[DESCRIPTOR_SIZE:], 1)
    assert len(scans) > 5
    assert pipeline.stats.lost_packets == 0
    assert all(scan.time_increment_ns == 0 for scan in scans)


def _scans_at_once(case: Case, behind: int, **about: object) -> list[Scan]:
    """Its scans, but for the first packets, where all came in one read."""
    run = in_one_run(case.make_format(), b"".join(case.packets[behind:]), 10**12)
    return SectorAssembler(stream_of(case, **about)).add(run)


@pytest.mark.parametrize("name", ["ydlidar_g2_11hz", "ldrobot_ld08_5hz", "camsense_x1_5hz"])
@pytest.mark.parametrize("behind", [0, 3, 40])
def test_where_the_speed_tells_the_rate_scans_that_came_at_one_moment_are_dated(name: str, behind: int) -> None:
    """Also the one that shows it, as where the program blocked its loop when the stream began."""
    case = next(each for each in CASES if each.name == name)
    rates = (case.sample_us * 1e3, case.sample_us * 2.5e3)
    scans = _scans_at_once(case, behind, sample_ns=0.0, may_take_ns=rates)
    told = _scans_at_once(case, behind)
    assert [scan.seq for scan in scans] == list(range(len(told)))
    np.testing.assert_allclose([scan.stamp_ns for scan in scans], [scan.stamp_ns for scan in told], atol=MS)


@pytest.mark.parametrize("sectors", [(), (8,)])
@pytest.mark.exhaustive("case", sample=CASES)
def test_short_packets_that_came_at_one_moment_are_counted_too(case: Case, sectors: tuple[int, ...]) -> None:
    """As where damage has spared them alone: how many an ordinary revolution has, nothing tells."""
    size = min(map(len, case.packets))
    short = [packet for packet in case.packets if len(packet) == size]
    assembler = SectorAssembler(stream_of(case, sample_ns=0.0))
    assembler.divide(sectors, lambda *_: None)
    assembler.add(in_one_run(case.make_format(), b"".join(short), 1))
    assembler.end()
    stats = assembler.stats
    assert stats.scan_packets + stats.discarded_packets + stats.doubled_packets == len(short)


def test_a_revolution_that_does_not_end_and_whose_times_fall_back_is_given_up() -> None:
    """A file, or a peer, says what time it is; the device tells no sample time."""
    kind = KINDS["0x85 dense"]
    stream = replace(kind.stream(), sample_ns=0.0)
    pipeline, size = Pipeline(stream), stream.most_bytes // 2
    for now in (3, 2, 1):
        assert pipeline.receive(blob("endless", size), now * 10_000_000) == []
    assert pipeline.stats.discarded_packets > 0


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_what_a_stream_measures_of_a_wrong_time_counts_from_then_on(factor: float) -> None:
    kind, scans = KINDS["0x84 ultra"], list[Scan]()
    true_ns = kind.stream().sample_ns
    pipeline = Pipeline(replace(kind.stream(), sample_ns=factor * true_ns))
    raw = capture(kind, 8.0)[DESCRIPTOR_SIZE:]
    for number, (begin, end) in enumerate(pairwise(range(0, len(raw), len(raw) // 800)), 1):
        scans += pipeline.receive(raw[begin:end], number * 10_000_000)
    assert scans[0].time_increment_ns == pytest.approx(factor * true_ns, rel=0.001)
    assert scans[-1].time_increment_ns == pytest.approx(true_ns, rel=0.01)
    assert (pipeline.stats.missed_scans, pipeline.stats.broken_scans) == (0, 0)


class Told(DenseDecoder):
    """Remembers what it was told of the time; what is decoded by which time stands in `used`."""

    used: ClassVar[list[float]] = []
    told = 0.0

    def tell_time(self, sample_ns: float, *, passes: bool = True) -> None:
        self.told = sample_ns
        super().tell_time(sample_ns, passes=passes)

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        self.used.append(self.told)
        return super()._heads(packets, following)


@pytest.mark.parametrize("sectors", [(), (8,)])
def test_the_decoder_goes_on_by_the_time_that_was_measured(sectors: tuple[int, ...]) -> None:
    """So it does where it was another one meanwhile: for revolutions that came together, or in pieces."""
    kind = KINDS["0x85 dense"]
    true_ns, raw = kind.stream().sample_ns, capture(kind, 8.0)[DESCRIPTOR_SIZE:]
    pipeline = Pipeline(replace(kind.stream(), sample_ns=0.8 * true_ns, decoder=Told()))
    pipeline.assembler.divide(sectors, lambda count, sector: None)
    reads = [0, 0.5, *(each / 100 for each in range(51, 700)), 7.5, 7.6, 7.7]
    for begin_s, end_s in pairwise(reads):
        begin, end = (round(len(raw) * each / 8) for each in (begin_s, end_s))
        pipeline.receive(raw[begin:end], round(end_s * 1e9))
    assert Told.used[-1] == pytest.approx(true_ns, rel=0.01)
