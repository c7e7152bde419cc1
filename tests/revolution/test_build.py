"""A scan that is built of a revolution is like one that was made by its class."""

import copy
import pickle
from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest

from lidario.filters import RangeFilter
from lidario.revolution.build import DatedRevolution, build_scan, turned_by
from lidario.revolution.partial import SampleArrays
from lidario.scans.scan import Scan
from tests.support.cases import CASES
from tests.support.streams import stream_of

DEVICE_ARRAYS = ("device_angles", "device_distances", "intensities")


def built(lost: int = 0, zero_offset_deg: float = -90.0) -> Scan:
    arrays = SampleArrays(np.array([1, 2], np.float32), np.array([30, 0], np.float32), np.array([7, 8], np.uint8))
    revolution = DatedRevolution(arrays, 5, 1e8, 2e8, 306.0, [(1, 40)] if lost else None)
    stream = stream_of(CASES[0], zero_offset_deg=zero_offset_deg)
    return build_scan(stream, revolution, wall_ns=10, sample_ns=31250.4, seq=3, lost=lost)


def test_every_field_is_set_as_the_class_sets_it() -> None:
    scan = built()
    public = {each.name: getattr(scan, each.name) for each in fields(Scan) if each.init}
    made = Scan(**public)
    assert type(scan) is Scan
    for each in fields(Scan):
        assert getattr(scan, each.name) is getattr(made, each.name), each.name
    assert (scan.stamp_ns, scan.wall_stamp_ns, scan.time_increment_ns, scan.duration_ns) == (5, 10, 31250, 10**8)
    assert (scan.rpm, scan.reported_rpm, scan.seam, scan.seq, scan.lost_packets) == (300.0, 306.0, 270.0, 3, 0)
    assert repr(scan) == repr(made)
    assert built(zero_offset_deg=450.0).seam == 90.0


@pytest.mark.parametrize("offset", [-1e-6, 359.999999, 270.00001, -1e-6 - 720])
def test_an_angle_that_was_turned_is_below_360_degrees(offset: float) -> None:
    """Single precision holds 359.99997 and 360, and nothing between."""
    angles = np.arange(0, 360, 1 / 64, dtype=np.float32)
    turned = turned_by(angles, offset)
    assert turned.min() >= 0
    assert turned.max() < 360
    apart = (turned - angles.astype(np.float64) - offset + 180) % 360 - 180
    assert np.abs(apart).max() < 1e-4


def test_where_samples_are_missing_is_told_where_packets_were_lost() -> None:
    scan = built(lost=2)
    assert (scan.lost_packets, scan.times_ns.tolist()) == (2, [5, 5 + 41 * 31250])


@pytest.mark.parametrize("of", [lambda scan: scan, Scan.sorted, lambda scan: scan.select(np.array([False, True]))])
@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, lambda scan: pickle.loads(pickle.dumps(scan))])
def test_a_copy_is_as_read_only_and_tells_the_same(way: Callable[[Scan], Scan], of: Callable[[Scan], Scan]) -> None:
    scan = of(built(lost=2).filtered(RangeFilter(lower_threshold=1.0)))
    for used in (False, True):
        if used:
            scan.directions()
        again = way(scan)
        for name in (*DEVICE_ARRAYS, "angles", "ranges", "times_ns", "left_out"):
            found = getattr(again, name)
            np.testing.assert_array_equal(found, getattr(scan, name), err_msg=name)
            assert not found.flags.writeable, name
        assert not any(each.flags.writeable for each in again.directions())
        np.testing.assert_array_equal(again.to_laserscan(5).ranges, scan.to_laserscan(5).ranges)
        assert again.to_laserscan(5).stamp_ns == scan.to_laserscan(5).stamp_ns
