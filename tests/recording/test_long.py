"""A long recording in driven time with troubles, of which only the latest files are kept."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.soak.recording import live, sum_of

SECOND = 100_000


def test_no_two_scans_of_a_day_have_the_same_check_value() -> None:
    """With 32 bits, of 200 000 that are kept, about ten were taken for other ones; they have 64."""
    random = np.random.default_rng(7)
    scans = [
        SimpleNamespace(device_angles=angles, device_distances=distances)
        for angles in random.random((30, 4))
        for distances in random.random((30, 4))
    ]
    values = {sum_of(scan) for scan in scans}  # type: ignore[arg-type]
    assert len(values) == len(scans)
    # Each of the bits is set in half of them.
    assert all(0.4 < sum(value >> bit & 1 for value in values) / len(values) < 0.6 for bit in range(64))


@pytest.mark.long
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
