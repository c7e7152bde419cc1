"""The system's wall clock is set while a stream runs, as on a computer that learns the time from the network."""

import time
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest
from mcap.reader import make_reader

from lidario import open_lidar
from lidario.port.wall_clock import WallClock
from lidario.recording.decode_file import FileDecoder
from lidario.recording.export import export_mcap
from lidario.recording.write import SCAN_TOPIC
from tests.support.devices import Rig, some

HOUR_NS = 3600 * 10**9


class _Clock:
    """The wall clock of this process, which can be set."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.ahead_ns = 0
        usual = time.time_ns
        patch.setattr(time, "time_ns", lambda: usual() + self.ahead_ns)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> _Clock:
    return _Clock(monkeypatch)


def ahead(scan: Any) -> int:
    return int(scan.wall_stamp_ns - scan.stamp_ns)


@pytest.mark.parametrize("step_ns", [HOUR_NS, -HOUR_NS, 50_000_000])
async def test_stamps_follow(rig: Rig, clock: _Clock, step_ns: int, caplog: pytest.LogCaptureFixture) -> None:
    async with rig.read() as (lidar, stream), lidar.sectors(90, depth=99) as sectors:
        first = await anext(sectors)
        before = await some(stream, 3)
        clock.ahead_ns = step_ns
        after = await some(stream, 4)
        last = (await some(sectors, 24))[-1]
    assert ahead(last) - ahead(first) == pytest.approx(step_ns, rel=0.05)
    assert len({ahead(scan) for scan in before}) == 1
    # Reading two clocks takes a moment.
    assert {round((ahead(scan) - ahead(before[0])) / step_ns, 1) for scan in after[1:]} == {1.0}
    assert [scan.seq - before[0].seq for scan in (*before, *after)] == list(range(7))
    assert len([text for text in caplog.messages if "clock" in text]) == 1


@pytest.mark.long
async def test_small_differences_are_no_setting(rplidar: Rig, clock: _Clock) -> None:
    async with rplidar.read() as (_, stream):
        first = await anext(stream)
        for number in range(15):
            clock.ahead_ns = number * 500_000
            last = await anext(stream)
    assert ahead(first) == ahead(last)


@pytest.mark.parametrize("begun_behind_it", [False, True])
async def test_a_replay_keeps_the_clock_with_which_its_recording_began(
    rplidar: Rig, clock: _Clock, tmp_path: Path, begun_behind_it: bool
) -> None:
    async with rplidar.read() as (lidar, stream):
        if begun_behind_it:
            clock.ahead_ns = HOUR_NS
            await some(stream, 2)
        async with lidar.record(tmp_path / "run.mcap"):
            first = await anext(stream)
            clock.ahead_ns += HOUR_NS * (not begun_behind_it)
            await some(stream, 4)
    async with open_lidar(tmp_path / "run.mcap") as replayed, replayed.scans() as again:
        assert {ahead(each) for each in await some(again, 3)} == {ahead(first)}


def times_in(path: Path) -> list[tuple[str, int]]:
    """The topics of the messages of a file, and when each was written by its own clock."""
    with open(path, "rb") as file:
        return [(channel.topic, message.log_time) for _, channel, message in make_reader(file).iter_messages()]


@pytest.mark.parametrize("step_ns", [HOUR_NS, -HOUR_NS])
async def test_scans_stand_in_a_recording_by_the_clock_with_which_it_began(
    rplidar: Rig, clock: _Clock, tmp_path: Path, step_ns: int
) -> None:
    """Beside the bytes that they were made of; what a scan says of the wall clock is another matter."""
    path, exported = tmp_path / "run.mcap", tmp_path / "exported.mcap"
    async with rplidar.open() as lidar, lidar.record(path, scans=True):
        for ahead_ns in (0, step_ns):
            clock.ahead_ns = ahead_ns
            # Each is a stream of its own, and so has the clock of its beginning.
            async with lidar.scans() as stream:
                await some(stream, 3)
    export_mcap(FileDecoder(path), exported)
    for times in (times_in(path), times_in(exported)):
        assert [topic for topic, _ in times].count(SCAN_TOPIC) >= 5
        assert max(at_ns for _, at_ns in times) - min(at_ns for _, at_ns in times) < 60e9


def test_a_thread_that_waits_while_it_reads_the_clocks_sees_no_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between any two readings it may have to wait: one in five times for 50 ms here. Else one takes about 1 us."""
    passed_ns, random = 0, Random(1)

    def clock_of(ahead_ns: int) -> Callable[[], int]:
        def read() -> int:
            nonlocal passed_ns
            passed_ns += random.randrange(500, 2000) + 50_000_000 * (random.random() < 0.2)
            return ahead_ns + passed_ns

        return read

    monkeypatch.setattr(time, "time_ns", clock_of(HOUR_NS))
    monkeypatch.setattr(time, "monotonic_ns", clock_of(0))
    clock = WallClock(time.monotonic_ns)
    first = clock.wall_offset_ns
    assert {clock.wall_offset_ns for _ in range(200)} == {first}
