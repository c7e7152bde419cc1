"""The Rerun example: what Rerun's own reader finds in the file is what the lidar saw."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.children import finished
from tests.support.example import PLACES
from tests.support.walls import WALLS, from_walls, is_all_around, is_at_ten_hertz

PROGRAM = f"""
import sys, rerun_live, lidario, lidario.testing
lidario.run(rerun_live.main(lidario.testing.SimulatedLidar(walls={WALLS}), sys.argv[1], count=3))
"""


@pytest.fixture(scope="module")
def reader() -> Any:
    """Rerun's own. To import it takes long, and starts threads that stay."""
    from rerun.chunk import RrdReader

    return RrdReader


@pytest.mark.long
def test_rerun_live_keeps_what_the_viewer_shows(tmp_path: Path, reader: Any) -> None:
    file = tmp_path / "run.rrd"
    assert finished("-c", PROGRAM, str(file), environment=PLACES).returncode == 0
    # Rerun writes a piece of the file whenever some time has passed: on a busy machine they are several.
    pieces = [chunk.to_record_batch() for chunk in reader(file).stream() if chunk.entity_path == "/lidar/scan"]
    found = sorted(
        (time, scan)
        for piece in pieces
        for time, scan in zip(
            piece["time"].cast("int64").to_pylist(), piece["Points3D:positions"].to_pylist(), strict=True
        )
    )
    assert is_at_ten_hertz([time for time, _ in found])
    assert len(found) == 3
    for points in (np.array(scan) for _, scan in found):
        assert len(points) > 3000
        assert not points[:, 2].any()
        assert is_all_around(points[:, :2])
        assert from_walls(points[:, :2]).max() < 0.01
