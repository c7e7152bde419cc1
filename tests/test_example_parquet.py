"""The Parquet example: what pyarrow reads of many recordings is what they hold."""

from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

import lidario
from tests.support.example import run_example
from tests.support.recorded import record

MODELS = ("rplidar-s2", "ydlidar-4ros", "ldrobot-ld06")


@pytest.mark.long
def test_day_to_parquet_keeps_every_scan(tmp_path: Path) -> None:
    day, into = tmp_path / "day", tmp_path / "into"
    day.mkdir()
    for number, model in enumerate(MODELS):
        record(day / f"{number}.mcap", f"sim://{model}", 5)
    done = run_example("day_to_parquet", str(day), str(into))
    assert done.returncode == 0, done.stderr
    expected = [scan for path in sorted(day.iterdir()) for scan in lidario.decode_file(path)]
    assert done.stdout == f"{len(expected)} scans of 3 recordings\n"
    table = pyarrow.parquet.read_table(into)
    assert table.num_rows == len(expected) >= 15
    for row, scan in zip(table.to_pylist(), expected, strict=True):
        assert (row["stamp_ns"], row["rpm"]) == (scan.wall_stamp_ns, scan.rpm)
        np.testing.assert_array_equal(np.array(row["angles"], np.float32), scan.angles)
        np.testing.assert_array_equal(np.array(row["ranges"], np.float32), scan.ranges)
