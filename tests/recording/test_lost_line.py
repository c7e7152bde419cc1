"""The line to the lidar is lost while it is recorded: the recording goes on, and tells what is missing."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

import lidario
from lidario.recording.decode_file import FileDecoder
from lidario.recording.read import McapRecording
from lidario.scan import Scan
from tests.support.loop import run_driven
from tests.support.recorded import assert_same_scans, replayed, thread_takes_no_time

MODELS = ["rplidar-s2", "rplidar-a1", "ydlidar-4ros", "ldrobot-ld06"]
SCANS = 80


def record(path: Path, source: str) -> tuple[list[Scan], lidario.Stats]:
    """Record so many scans of a lidar whose cable is pulled out again and again."""

    async def main() -> tuple[list[Scan], lidario.Stats]:
        async with lidario.open_lidar(source, reconnect=True) as lidar:
            async with lidar.record(path) as recording, lidar.scans(depth=64) as stream:
                scans = [await anext(stream) for _ in range(SCANS)]
            assert recording.error is None
            assert not recording.lost_bytes
            return scans, lidar.stats

    with thread_takes_no_time():
        return run_driven(main)


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_a_recording_goes_on_over_the_next_line(tmp_path: Path, model: str) -> None:
    scans, stats = record(tmp_path / "a.mcap", f"sim://{model}?via=memory&fault=replug:6s")
    assert stats.reconnects >= 1
    decoder = FileDecoder(tmp_path / "a.mcap")
    assert_same_scans(scans, list(decoder))
    assert decoder.recording.damage == ""
    assert_same_scans(scans, replayed(tmp_path / "a.mcap"))


@pytest.mark.long
@pytest.mark.parametrize("model", ["rplidar-s2", "ydlidar-4ros"])
def test_so_does_a_device_that_restarts_by_itself(tmp_path: Path, model: str) -> None:
    scans, stats = record(tmp_path / "a.mcap", f"sim://{model}?via=memory&fault=reboot:6s")
    assert stats.restarts + stats.reconnects
    assert_same_scans(scans, list(FileDecoder(tmp_path / "a.mcap")))
    assert_same_scans(scans, replayed(tmp_path / "a.mcap"))


def test_what_was_away_is_told(tmp_path: Path) -> None:
    scans, stats = record(tmp_path / "a.mcap", "sim://rplidar-s2?via=memory&fault=replug:6s")
    recording = McapRecording(tmp_path / "a.mcap")
    assert len(recording.away_ns) == stats.reconnects
    gaps = [b.stamp_ns - a.stamp_ns - a.duration_ns for a, b in pairwise(scans)]
    # All that lies between two scans, but for the parts of revolutions and the spinning up at the edges of a gap.
    longest = sorted(gaps)[-stats.reconnects :]
    assert all(0 <= gap - away < 2.5e9 for gap, away in zip(longest, sorted(recording.away_ns), strict=True))
    summary = lidario.summarize(tmp_path / "a.mcap")
    assert summary.losses == stats.reconnects
    assert summary.away_s == pytest.approx(sum(recording.away_ns) * 1e-9)
