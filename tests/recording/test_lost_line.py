"""The line to the lidar is lost while it is recorded: the recording goes on, and tells what is missing."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

import lidario
from lidario.recording.decode_file import FileDecoder
from lidario.recording.read import McapRecording
from tests.support.recorded import assert_same_scans, record, replayed

MODELS = ["rplidar-s2", "rplidar-a1", "ydlidar-4ros", "ldrobot-ld06"]
SCANS = 80


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_a_recording_goes_on_over_the_next_line(tmp_path: Path, model: str) -> None:
    live = record(tmp_path / "a.mcap", f"sim://{model}?fault=replug:6s", SCANS)
    assert live.stats.reconnects >= 1
    decoder = FileDecoder(tmp_path / "a.mcap")
    assert_same_scans(live.scans, list(decoder))
    assert decoder.recording.damage == ""
    assert_same_scans(live.scans, replayed(tmp_path / "a.mcap"))


@pytest.mark.long
@pytest.mark.parametrize("model", ["rplidar-s2", "ydlidar-4ros"])
def test_so_does_a_device_that_restarts_by_itself(tmp_path: Path, model: str) -> None:
    live = record(tmp_path / "a.mcap", f"sim://{model}?fault=reboot:6s", SCANS)
    assert live.stats.restarts + live.stats.reconnects
    assert_same_scans(live.scans, list(FileDecoder(tmp_path / "a.mcap")))
    assert_same_scans(live.scans, replayed(tmp_path / "a.mcap"))


@pytest.mark.long
def test_what_was_away_is_told(tmp_path: Path) -> None:
    live = record(tmp_path / "a.mcap", "sim://rplidar-s2?fault=replug:6s", SCANS)
    recording = McapRecording(tmp_path / "a.mcap")
    assert len(recording.away_ns) == live.stats.reconnects
    gaps = [b.stamp_ns - a.stamp_ns - a.duration_ns for a, b in pairwise(live.scans)]
    # All that lies between two scans, but for the parts of revolutions and the spinning up at the edges of a gap.
    longest = sorted(gaps)[-live.stats.reconnects :]
    assert all(0 <= gap - away < 2.5e9 for gap, away in zip(longest, sorted(recording.away_ns), strict=True))
    summary = lidario.summarize(tmp_path / "a.mcap")
    assert summary.losses == live.stats.reconnects
    assert summary.away_s == pytest.approx(sum(recording.away_ns) * 1e-9)
