"""All scans of a stream on one grid, whatever the first ones are like."""

from dataclasses import replace
from itertools import chain

import numpy as np
import pytest

from lidario.filters import RangeFilter
from lidario.scans.laserscan import LaserScan
from lidario.scans.laserscans import MOST_WAITING, LaserScans
from lidario.scans.scan import Scan
from lidario.testing import make_scan
from tests.support.sweep import WALL, Sweep, check, sweep


def turning(*speeds_hz: float) -> list[Scan]:
    return [sweep(hertz=hertz, sample_us=500).scan for hertz in speeds_hz]


def grids(messages: list[LaserScan]) -> set[tuple[int, float, float]]:
    return {(len(each.ranges), each.angle_min, each.angle_increment) for each in messages}


def test_the_grid_is_not_that_of_a_motor_that_spins_up() -> None:
    messages, scans = LaserScans(), turning(3.0, 5.0, 8.0, 10.0, 10.0, 12.0, 9.0)
    ready = [[scan for scan, _ in messages.take(each)] for each in scans]
    # Nothing while it speeds up, then all in their order, then each at once.
    assert ready == [[], [], [], [], scans[:5], scans[5:6], scans[6:7]]
    assert messages.beams == 200
    assert repr(messages) == "<LaserScans: 200 beams>"


@pytest.mark.long
def test_all_are_on_it_also_where_much_is_missing() -> None:
    messages = LaserScans(order="measured", mount_yaw=0.3, preset="vendor", frame_id="front")
    truths = [
        sweep(hertz=hertz, sample_us=500, gaps=gaps)
        for hertz in (9.0, 10.0, 8.0)
        for gaps in ((), [(0.0, 0.1)], [(0.4, 0.3)], [(0.95, 0.05)])
    ]
    made = list(chain.from_iterable(messages.take(truth.scan) for truth in truths))
    assert [id(scan) for scan, _ in made] == [id(truth.scan) for truth in truths]
    assert len(grids([message for _, message in made])) == 1
    for (_, message), truth in zip(made, truths, strict=True):
        check(message, truth, 0.3 + np.pi)
        assert message.frame_id == "front"


@pytest.mark.parametrize("begin", [351.0, 9.0])
def test_a_grid_that_begins_elsewhere_has_the_right_times(begin: float) -> None:
    truth: Sweep = sweep(hertz=10, sample_us=500, phase=0.5)
    laser = truth.scan.to_laserscan(begin_deg=begin)
    assert laser.angle_min == pytest.approx(np.radians(-begin % 360 - 360 * (begin < 180) + 0.9), abs=1e-6)
    rising = truth.scan.to_laserscan(begin_deg=begin, order="measured")
    np.testing.assert_array_equal(laser.ranges[::-1], rising.ranges)
    # Beams are where they were, at the same times; only those at the ends are others, by five.
    plain = truth.scan.to_laserscan()
    ours, others = (slice(6, 199), slice(1, 194)) if begin < 180 else (slice(1, 194), slice(6, 199))
    np.testing.assert_array_equal(laser.ranges[ours], plain.ranges[others])
    times, wanted = (each.stamp_ns + np.arange(200) * each.time_increment * 1e9 - WALL for each in (laser, plain))
    np.testing.assert_allclose(times[ours], wanted[others], atol=1e6)


@pytest.mark.parametrize("begin", [20.0, 90.0, 180.0, 270.0, 340.0])
def test_a_grid_that_begins_amid_the_revolution_has_every_return_at_its_angle(begin: float) -> None:
    angles = -np.radians(np.arange(360) + 0.5)
    laser = make_scan(angles, 1 + np.arange(360) / 100).to_laserscan(360, begin_deg=begin, order="measured")
    np.testing.assert_allclose(laser.ranges, 1 + (np.arange(360) + begin) % 360 / 100, rtol=1e-6)


def test_a_grid_beside_the_field_of_a_device_has_only_what_is_in_it() -> None:
    angles = (240.5 + np.arange(240)) % 360
    made = make_scan(-np.radians(np.sort(angles)), 1.0)
    scan = replace(made, device_angles=angles.astype(np.float32), field_of_view=240.0, seam=240.0)
    for order in ("measured", "counter-clockwise"):
        assert np.isfinite(scan.to_laserscan(order=order).ranges).all()
        laser = scan.filtered(RangeFilter(2.0)).to_laserscan(begin_deg=300.0, order=order, filtered="zero")
        ranges = laser.ranges if order == "measured" else laser.ranges[::-1]
        assert (ranges[:180] == 0.0).all()
        assert np.isnan(ranges[180:]).all()


@pytest.mark.long
def test_a_motor_that_never_has_its_speed_is_not_waited_for_for_ever() -> None:
    messages = LaserScans()
    scans = turning(*np.geomspace(1.0, 20.0, 2 * MOST_WAITING))
    ready = [len(list(messages.take(each))) for each in scans]
    assert ready == [0] * (MOST_WAITING - 1) + [MOST_WAITING] + [1] * MOST_WAITING


def test_what_waits_is_not_lost_at_the_end() -> None:
    messages = LaserScans()
    (scan,) = turning(10.0)
    assert repr(messages) == "<LaserScans: no grid yet>"
    assert not list(messages.take(scan))
    ((same, message),) = messages.rest()
    assert same is scan
    assert message.to_cdr() == scan.to_laserscan().to_cdr()
    assert not list(messages.rest())


def test_empty_and_sorted_scans() -> None:
    messages = LaserScans()
    scan, again = turning(10.0, 10.0)
    assert not list(messages.take(scan.select(np.zeros(len(scan), bool))))
    made = [*messages.take(scan.sorted()), *messages.take(again)]
    assert [message.to_cdr() for _, message in made] == [scan.to_laserscan().to_cdr()] * 2


def test_a_scan_that_states_no_time_of_its_samples() -> None:
    messages = LaserScans()
    (scan,) = turning(10.0)
    list(messages.take(replace(scan, time_increment_ns=0)))
    assert [len(message.ranges) for _, message in messages.rest()] == [len(scan)]
