"""The odometry example: a simulated lidar drives through a room, and is where the example says."""

import math
import re
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import lidario
from lidario.testing import Drive, SimulatedLidar, furnished

STOPS = [
    (0.5, 0.0, 0.0, 0.0),
    (5.5, 2.0, 0.0, 0.0),
    (8.0, 2.0, 0.0, math.pi / 2),
    (10.0, 2.0, 0.5, math.pi / 2),
    (12.5, 2.0, 0.5, math.pi),
    (18.5, -1.0, 0.5, math.pi),
]


def way_along(stops: list[tuple[float, float, float, float]]) -> list[tuple[float, float, float, float]]:
    """From one stop to the next, as robots drive: faster at first, slower at last."""
    table = np.array(stops)
    seconds = np.arange(0.0, table[-1, 0], 0.02)
    share = np.interp(seconds, table[:, 0], np.arange(len(table)))
    eased = np.floor(share) + (1.0 - np.cos(np.pi * (share % 1.0))) / 2.0
    x, y, yaw = (np.interp(eased, np.arange(len(table)), column).tolist() for column in table[:, 1:].T)
    return list(zip(seconds.tolist(), x, y, yaw, strict=True))


PATH = way_along(STOPS)


EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.mark.long
async def test_odometry(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    example = import_module("odometry")
    drive = Drive(PATH, furnished(), noise=0.005)
    lidar = SimulatedLidar("rplidar-c1", world=drive)
    # Both as the example names them.
    monkeypatch.setattr(example, "DRIVE", drive)
    monkeypatch.setattr(example, "SimulatedLidar", lambda world: lidar)
    off = await example.main(count=180)
    told = capsys.readouterr().out
    far, turned = (max(each) for each in zip(*off, strict=True))
    print(f"{len(off)} scans, {1000 * far:.1f} mm and {math.degrees(turned):.2f} degrees off at most")
    # Nearly at the end of its way, and it knows it.
    at = complex(re.search(r"^at (\S+) m, off by", told, re.MULTILINE)[1])  # type: ignore[index]
    assert -1.0 < at.real < -0.9
    assert abs(at.imag - STOPS[-1][2]) < 0.03
    assert f"off by {far:.3f} m at most" in told
    assert far < 0.03
    assert math.degrees(turned) < 1.0
    assert lidar.is_still
    # The wall ahead of where it began, 4.6 m away, is on the grid; what it drove through is free.
    assert told.count("#") > 50
    assert told.count(".") > 1000
    sys.modules.pop("odometry")
    sys.modules.pop("occupancy_grid")


@pytest.mark.long
async def test_a_recording_that_ends_early(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "short.mcap"
    async with lidario.open_lidar(SimulatedLidar()) as lidar, lidar.record(path) as recording:
        async for _ in lidar.scans():
            if recording.scans >= 3:
                break
    monkeypatch.syspath_prepend(str(EXAMPLES))
    off = await import_module("odometry").main(f"{path}?rate=0")
    assert 0 < len(off) < 110
    assert re.search(r"^at \S+ m$", capsys.readouterr().out, re.MULTILINE)
    sys.modules.pop("odometry")
    sys.modules.pop("occupancy_grid")
