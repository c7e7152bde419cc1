"""Resampling onto the grid of a LaserScan: what each beam says. Its times are in `tests.scans.test_beam_times`."""

import math
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lidario.errors import InvalidValue
from lidario.filters import RangeFilter
from lidario.scans.laserscan import LaserScan
from tests.scans.test_scan import FOUR, scan
from tests.support.sweep import ORDERS, sweep

WALL = 10**18


def at(laser: LaserScan, degrees: float) -> float:
    """The range of the beam whose share of the circle contains an angle, or what is just clockwise of it."""
    place = math.floor((math.radians(degrees - 1e-3) - laser.angle_min) / laser.angle_increment + 0.5)
    return float(laser.ranges[place % len(laser.ranges)])


def test_the_grid() -> None:
    laser = FOUR.to_laserscan(360)
    assert len(laser.ranges) == 360
    assert laser.ranges.dtype == np.float32
    assert laser.angle_min == pytest.approx(math.radians(0.5))
    assert laser.angle_increment == pytest.approx(math.radians(1))
    assert laser.angle_max == pytest.approx(math.radians(359.5))
    assert laser.scan_time == pytest.approx(0.1)
    assert laser.time_increment == pytest.approx(-0.1 / 360)
    assert laser.frame_id == "laser"
    # The first beam was measured last, half a beam before the end of the revolution.
    assert laser.stamp_ns == WALL + 5 + round(0.1e9 * 359.5 / 360)
    assert [at(laser, each) for each in (0, -90, 180, 90)] == [1.0, 2.0, math.inf, 4.0]
    # Where nothing was measured, nothing is known.
    assert np.isnan(laser.ranges).sum() == 356
    assert len(FOUR.to_laserscan().ranges) == 4


def test_the_order_of_measuring_is_the_same_grid_backwards() -> None:
    made = sweep(hertz=10, sample_us=500, gaps=[(0.3, 0.1)])
    made_scan = replace(made.scan, intensities=np.arange(len(made.scan)).astype(np.uint8))
    usual, measured = (made_scan.to_laserscan(360, order=order, mount_yaw=0.3) for order in ORDERS)
    np.testing.assert_array_equal(measured.ranges, usual.ranges[::-1])
    np.testing.assert_array_equal(measured.intensities, usual.intensities[::-1])
    assert (measured.angle_min, measured.angle_max) == (usual.angle_max, usual.angle_min)
    assert measured.angle_increment == -usual.angle_increment < 0
    assert measured.time_increment == -usual.time_increment > 0
    last_ns = usual.stamp_ns + 359 * usual.time_increment * 1e9
    assert measured.stamp_ns == pytest.approx(last_ns, abs=1000)
    for laser in (usual, measured):
        assert laser.ranges.flags.c_contiguous
        assert laser.angle_max == pytest.approx(laser.angle_min + 359 * laser.angle_increment)


@pytest.mark.parametrize(("word", "value"), [("inf", math.inf), ("nan", math.nan), ("zero", 0.0)])
def test_a_beam_without_a_return(word: Any, value: float) -> None:
    assert at(FOUR.to_laserscan(360, no_return=word), 180) == pytest.approx(value, nan_ok=True)


def test_the_nearest_return_wins_in_a_beam() -> None:
    near = scan([50.5, 10.7, 10.5, 10.4, 10.2], [7, 2, 0, 1.5, 3], [5, 4, 3, 2, 1])
    laser = near.to_laserscan(360)
    assert at(laser, 10.5) == 1.5
    place = int(np.flatnonzero(laser.ranges == np.float32(1.5))[0])
    assert laser.intensities[place] == 2
    assert laser.intensities.dtype == np.float32
    assert laser.intensities.sum() == 2 + 5
    # A return wins over none, in either order.
    assert at(scan([10.6, 10.4], [0, 3]).to_laserscan(360), 10.5) == 3
    assert at(scan([10.6, 10.4], [3, 0]).to_laserscan(360), 10.5) == 3


def test_what_is_out_of_the_range_asked_for_did_not_return() -> None:
    far = scan([-5, -10, -20, -30, -40], [0.04, 0.05, 12, 12.1, 5])
    laser = far.to_laserscan(360, range_min=0.05, range_max=12.0)
    assert [at(laser, each) for each in (-5, -10, -20, -30, -40)] == pytest.approx(
        [math.inf, 0.05, 12, math.inf, 5]
    )
    assert (laser.range_min, laser.range_max) == (0.05, 12.0)


def test_a_range_that_no_message_holds_is_none() -> None:
    far = scan([-10, -20], [29, 31], max_range=1e39)
    for limit in (sys.float_info.max, 1e39, math.inf):
        laser = far.to_laserscan(360, range_max=limit)
        assert (laser.range_max, at(laser, -20)) == (math.inf, 31)
        sent = LaserScan.from_cdr(laser.to_cdr())
        assert sent is not None
        assert sent.range_max == math.inf
        assert len(far.select(range_max=limit)) == len(far.filtered(RangeFilter(0.0, limit))) == 2
        assert len(far.select(range_min=limit)) == 0
    assert far.to_laserscan(360).range_max == 40.0
    with pytest.raises(InvalidValue, match="range_min must be"):
        far.to_laserscan(360, range_min=1e39)


@pytest.mark.parametrize(("told", "stated"), [(30.0, 30.0), (0.0, 40.0), (math.nan, 40.0), (math.inf, 40.0)])
def test_the_longest_range_is_the_modes_and_describes_without_filtering(told: float, stated: float) -> None:
    laser = scan([-10, -20], [29, 31], max_range=told).to_laserscan(360)
    assert laser.range_max == stated
    assert [at(laser, -10), at(laser, -20)] == [29, 31]
    # Asked for, it is a filter.
    asked = scan([-10, -20], [29, 31], max_range=told).to_laserscan(360, range_max=30.0)
    assert asked.range_max == 30.0
    assert [at(asked, -10), at(asked, -20)] == [29, math.inf]


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, -math.pi, 7.0])
def test_the_mounting_turns_the_scan(yaw: float) -> None:
    laser = FOUR.to_laserscan(360, mount_yaw=yaw, frame_id="base")
    assert at(laser, math.degrees(yaw)) == 1.0
    assert at(laser, math.degrees(yaw) - 90) == 2.0
    assert -math.pi <= laser.angle_min < math.pi + laser.angle_increment
    assert laser.frame_id == "base"


@pytest.mark.parametrize("count", [336, 400, 808, 832, 3201])
@pytest.mark.parametrize("begin", [0.0, 7.3])
def test_evenly_spaced_samples_have_a_beam_each(count: int, begin: float) -> None:
    """Though they stand at the edges of beams, where rounding would decide."""
    degrees = begin + np.arange(count) * 360 / count
    even = scan(-degrees, 1 + np.arange(count) / 1000, seam=begin, time_increment_ns=10**8 // count, lost_packets=0)
    np.testing.assert_array_equal(even.to_laserscan(order="measured").ranges, even.ranges)
    # As well where each has half a beam.
    assert np.isnan(even.to_laserscan(2 * count, order="measured").ranges[1::2]).all()


@pytest.mark.parametrize("off", [0.3, 0.9, 2.0])
def test_samples_beyond_an_end_of_the_grid_stay_at_that_end(off: float) -> None:
    """As corrected angles may be; at the other end they would be of another time by a whole revolution."""
    laser = scan([off, -90, -180, -270, -360 - off], [1, 2, 3, 4, 5]).to_laserscan(36, order="measured")
    np.testing.assert_array_equal(laser.ranges[[0, 9, 18, 27, 35]], [1, 2, 3, 4, 5])


def test_formats_without_intensity_have_none_in_ros() -> None:
    assert scan([0], [1]).to_laserscan().intensities.shape == (0,)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_scans_of_hardly_any_samples(count: int) -> None:
    laser = scan([-10.0, -20.0][:count], [1.0, 2.0][:count]).to_laserscan(72)
    assert np.isnan(laser.ranges).sum() == 72 - count
    assert laser.scan_time == pytest.approx(0.1)


def test_misuse() -> None:
    for beams in (0, -1, 10**7):
        with pytest.raises(InvalidValue, match="1 to 1000000 beams"):
            FOUR.to_laserscan(beams)
    with pytest.raises(InvalidValue, match="1 to 1000000 beams"):
        scan([], []).to_laserscan()
    for wrong in (1.5, "9", 360.0):
        with pytest.raises(InvalidValue, match="beams is a whole number"):
            FOUR.to_laserscan(wrong)  # type: ignore[arg-type]
    with pytest.raises(InvalidValue, match="no_return must be one of inf, nan, zero"):
        FOUR.to_laserscan(10, no_return="none")  # type: ignore[arg-type]
    with pytest.raises(InvalidValue, match="order must be one of counter-clockwise, measured"):
        FOUR.to_laserscan(10, order="clockwise")  # type: ignore[arg-type]
    for yaw in (math.nan, math.inf):
        with pytest.raises(InvalidValue, match=r"mount_yaw is a (finite )?number"):
            FOUR.to_laserscan(10, mount_yaw=yaw)
    for least, most in ((-1.0, 5.0), (6.0, 5.0), (math.nan, 5.0), (0.05, math.nan)):
        with pytest.raises(InvalidValue, match=r"range_min must be between|is a (finite )?number"):
            FOUR.to_laserscan(10, range_min=least, range_max=most)
    assert len(FOUR.to_laserscan(np.int64(10)).ranges) == 10


def test_samples_in_no_order_lose_nothing() -> None:
    jumbled = scan([20, -170, 90, -3, 5, 160, -80], [1, 2, 3, 4, 5, 6, 7])
    laser = jumbled.to_laserscan(36)
    assert sorted(laser.ranges[np.isfinite(laser.ranges)].tolist()) == [1, 2, 3, 4, 5, 6, 7]
