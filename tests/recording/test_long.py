"""A long recording in driven time with troubles, of which only the latest files are kept."""

from pathlib import Path

import pytest

from benchmarks.soak.recording import live

SECOND = 100_000


@pytest.mark.parametrize(("family", "keep"), [("ldrobot", 500_000), ("ydlidar", 2_000_000)])
def test_nothing_is_missing_but_what_was_told(tmp_path: Path, family: str, keep: int, soak: float) -> None:
    day = live(tmp_path, 120.0 * soak, seed=3, split_s=10.0, keep_bytes=keep, family=family, mean_s=15.0)
    assert (day.missing, day.unreadable, day.damage) == (0, [], "")
    # The last one was not complete for its reader.
    assert day.other <= 1
    assert day.reconnects > day.losses > 0
    assert day.kept < day.scans
    # The oldest goes when a second has been written.
    assert day.largest <= keep + SECOND
    begun, kept = day.files
    assert begun > kept > 1
