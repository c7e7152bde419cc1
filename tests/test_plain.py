"""`to_dict`: a scan, a sector and a message as JSON has them."""

import json
import math

import numpy as np
import pytest

from lidario.testing import make_scan, make_sector

ANGLES, RANGES = [0.0, -0.5, -1.0], [2.0, math.nan, 0.12345]


def test_a_scan_is_its_own_fields() -> None:
    scan = make_scan(ANGLES, RANGES, intensities=[1, 2, 3], seq=7, lost_packets=2, max_range=30.0)
    told = json.loads(json.dumps(scan.to_dict(), allow_nan=False))
    units = told.pop("units")
    assert told["ranges"] == [2.0, None, pytest.approx(float(scan.ranges[2]), abs=1e-5)]
    assert told["angles"] == pytest.approx(scan.angles.tolist(), abs=1e-6)
    assert told["intensities"] == [1, 2, 3]
    assert told["reported_rpm"] is None
    for name in told.keys() - {"angles", "ranges", "intensities", "reported_rpm"}:
        assert told[name] == getattr(scan, name), name
    assert {name for name in told if name not in units} == {
        "seq", "mode", "dropped_before", "lost_packets", "intensities"
    }  # fmt: skip
    assert units["angles"].startswith("rad")
    assert make_scan(ANGLES, RANGES).to_dict()["intensities"] is None


def test_a_sector_says_which_one_it_is() -> None:
    told = make_sector(-np.radians([50, 60, 70]), 2.0, degrees=45, index=1, seq=3).to_dict()
    assert (told["seq"], told["index"], told["degrees"]) == (3, 1, 45.0)
    assert told["ranges"] == [2.0] * 3
    assert told["units"]["degrees"] == "deg"


def test_a_message_has_no_infinite_number() -> None:
    laser = make_scan(ANGLES, RANGES).to_laserscan(100)
    told = laser.to_dict()
    assert np.isinf(laser.ranges).any()
    assert np.isnan(laser.ranges).any()
    assert [each is None for each in told["ranges"]] == (~np.isfinite(laser.ranges)).tolist()
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert told["units"]["angle_increment"] == "rad"
