"""Scans in the hand: points, sorting, resampling, JSON; and the small records."""

import inspect
import json
import math
import pydoc
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.basics.model import Health, HealthStatus, ScanMode
from lidario.errors import InvalidValue
from lidario.scans.scan import Scan
from lidario.testing import make_scan, make_sector


def scan(degrees: Any, metres: Any, intensities: Any = None, **about: Any) -> Scan:
    """A scan of these counter-clockwise degrees and metres; 0 for no return."""
    metres = np.asarray(metres, np.float32)
    values: dict[str, Any] = {
        "intensities": None if intensities is None else np.asarray(intensities, np.uint8),
        "device_angles": (-np.asarray(degrees, np.float64) % 360).astype(np.float32),
        "device_distances": metres * 1000,
        "stamp_ns": 5,
        "wall_stamp_ns": 10**18 + 5,
        "time_increment_ns": 1000,
        "duration_ns": 100_000_000,
        "rpm": 600.0,
        "seq": 3,
        "dropped_before": 1,
        "lost_packets": 2,
        "mode": "DenseBoost",
    }
    return Scan(**(values | about))


FOUR = scan([0, -90, 180, 90], [1, 2, 0, 4], [10, 20, 30, 40])


def test_points() -> None:
    xy = FOUR.xy()
    assert xy.shape == (4, 2)
    assert xy.dtype == np.float32
    # Forward is x, left is y; a clockwise scanner looks right next.
    np.testing.assert_allclose(xy[[0, 1, 3]], [[1, 0], [0, -2], [0, 4]], atol=1e-6)
    assert np.isnan(xy[2]).all()
    assert FOUR.valid.tolist() == [True, True, False, True]
    np.testing.assert_allclose(xy[FOUR.valid], FOUR.xy()[FOUR.valid])


def test_sorting_reorders_every_array_alike_and_keeps_the_rest() -> None:
    ordered = FOUR.sorted()
    np.testing.assert_allclose(np.degrees(ordered.angles), [-180, -90, 0, 90], atol=1e-4)
    assert ordered.device_distances.tolist() == [0, 2000, 1000, 4000]
    assert ordered.intensities is not None
    assert ordered.intensities.tolist() == [30, 20, 10, 40]
    assert ordered.device_angles.tolist() == [180, 90, 0, 270]
    names = ["angles", "ranges", *(field.name for field in fields(Scan) if not field.name.startswith("_"))]
    for name in names:
        before, after = getattr(FOUR, name), getattr(ordered, name)
        if isinstance(before, np.ndarray):
            assert not after.flags.writeable
            assert after.dtype == before.dtype
        else:
            assert after is before or after == before
    assert scan([1, 0], [1, 2]).sorted().intensities is None
    assert len(scan([], []).sorted()) == 0


def test_radians_and_metres_are_made_once_of_the_devices_own_figures() -> None:
    device = np.linspace(0, 360, 5000, endpoint=False, dtype=np.float32)
    millimetres = np.where(np.arange(5000) % 7, np.arange(5000), 0).astype(np.float32)
    made = replace(FOUR, device_angles=device, device_distances=millimetres, intensities=None)
    exact = -np.radians((device.astype(np.float64) + 180) % 360 - 180)
    exact[device == 180] = -np.pi
    # One rounding, of a number of up to pi.
    np.testing.assert_allclose(made.angles, exact, rtol=0, atol=2.4e-7)
    assert -np.pi <= made.angles.min() < made.angles.max() <= np.pi
    np.testing.assert_allclose(made.ranges[millimetres > 0], millimetres[millimetres > 0] / 1000, rtol=2e-7)
    assert np.isnan(made.ranges[millimetres == 0]).all()
    for array in (made.angles, made.ranges):
        assert array.dtype == np.float32
        assert not array.flags.writeable
    assert made.angles is made.angles
    assert made.ranges is made.ranges
    # Another scan made from it has its own.
    assert replace(made, device_angles=device[::-1]).angles[0] == made.angles[-1]


# ---------------------------------------------------------------------------------------------------- records


def test_help_tells_what_each_of_them_is() -> None:
    shown = pydoc.plain(pydoc.render_doc(Scan))
    for name in ("angles", "ranges", "valid", "left_out", "times_ns"):
        told = str(inspect.getdoc(getattr(Scan, name)))
        assert told.splitlines()[0] in shown, name


def test_health() -> None:
    assert [Health(status, 0).ok for status in HealthStatus] == [True, True, False]
    assert [status.value for status in HealthStatus] == ["ok", "warning", "error"]


def test_a_mode_knows_its_rate() -> None:
    assert ScanMode(1, "D", 31.25, 30.0, 0x85).samples_per_second == 32_000
    assert math.isnan(ScanMode(1, "D", 0.0, 30.0, 0x85).samples_per_second)


class TestTimes:
    def test_of_a_sorted_scan_go_with_the_samples(self) -> None:
        made = scan([0, -90, 180, 90], [1, 2, 0, 4], lost_packets=0).sorted()
        assert made.times_ns.tolist() == [2005, 1005, 5, 3005]


class TestNearest:
    @pytest.mark.parametrize(
        ("between", "index"),
        [
            ((math.radians(-100), math.radians(-80)), 1),
            ((math.radians(80), math.radians(100)), 3),
            ((math.radians(30), math.radians(-30)), 1),
            ((0.0, 0.0), 0),
            ((-math.pi, math.pi), 0),
            ((0.1 - math.tau, 0.1), 0),
            ((math.radians(80), math.radians(-80 + 360)), 1),
            ((math.radians(80), math.radians(-100 + 360)), 3),
        ],
    )
    def test_between(self, between: tuple[float, float], index: int) -> None:
        found = FOUR.nearest(between)
        assert found is not None
        assert found.index == index

    @given(st.floats(0, 360, width=32, exclude_max=True), st.floats(0.125, 70_000, width=32))
    def test_is_what_the_arrays_say_to_the_last_bit(self, angle: float, distance: float) -> None:
        arrays = [np.array([each], np.float32) for each in (angle, distance)]
        made = replace(FOUR, device_angles=arrays[0], device_distances=arrays[1])
        found = made.nearest()
        assert found is not None
        assert (found.range, found.angle) == (float(made.ranges[0]), float(made.angles[0]))

    def test_where_nothing_came_back(self) -> None:
        assert FOUR.nearest((math.radians(150), math.radians(-150))) is None
        assert scan([0, 1], [0, 0]).nearest() is None
        assert scan([], []).nearest() is None

    @pytest.mark.parametrize("between", [(math.nan, 1.0), (0.0, math.inf)])
    def test_angles_that_are_none(self, between: tuple[float, float]) -> None:
        with pytest.raises(InvalidValue, match="two finite angles"):
            FOUR.nearest(between)


class TestAt:
    @pytest.mark.parametrize(
        ("angle", "index"), [(0.0, 0), (-1.57, 1), (math.pi, 2), (-math.pi, 2), (7.854 - math.tau, 3)]
    )
    def test_the_nearest_sample(self, angle: float, index: int) -> None:
        found = FOUR.at(angle)
        assert found is not None
        assert found.index == index
        assert math.isnan(found.range) == (index == 2)

    def test_where_there_is_none(self) -> None:
        assert FOUR.at(0.5) is None
        found = FOUR.at(0.5, within=0.6)
        assert found is not None
        assert found.index == 0
        assert scan([], []).at(0) is None

    @pytest.mark.parametrize(("angle", "within"), [(math.nan, 1.0), (0.0, -1.0), (0.0, math.nan)])
    def test_nonsense(self, angle: float, within: float) -> None:
        with pytest.raises(InvalidValue, match=r"an angle|within"):
            FOUR.at(angle, within=within)


class TestSelect:
    def test_by_mask_angle_and_range(self) -> None:
        assert FOUR.intensities is not None
        assert FOUR.select(FOUR.intensities > 15).device_distances.tolist() == [2000, 0, 4000]
        assert FOUR.select(between=(-1.6, 0.1)).device_distances.tolist() == [1000, 2000]
        assert FOUR.select(range_max=2).device_distances.tolist() == [1000, 2000]
        assert FOUR.select(range_min=1.5).device_distances.tolist() == [2000, 4000]
        assert FOUR.select(FOUR.valid, between=(-1.6, 1.6), range_min=1.5).device_distances.tolist() == [2000, 4000]
        assert FOUR.select().device_distances.tolist() == [1000, 2000, 0, 4000]
        assert len(FOUR.select(range_min=100)) == 0

    def test_keeps_the_times(self) -> None:
        whole = scan([0, -90, 180, 90], [1, 2, 0, 4], lost_packets=0)
        some = whole.select(whole.ranges > 1.5)
        assert some.times_ns.tolist() == [1005, 3005]
        assert some.stamp_ns == 1005
        assert some.wall_stamp_ns - whole.wall_stamp_ns == 1000
        assert some.stamp_ns + some.duration_ns == whole.stamp_ns + whole.duration_ns
        assert some.select(some.ranges > 3).times_ns.tolist() == [3005]

    def test_of_a_sorted_scan_is_the_sorted_selection(self) -> None:
        mask = FOUR.sorted().ranges < 3
        some = FOUR.sorted().select(mask)
        np.testing.assert_array_equal(some.ranges, FOUR.sorted().ranges[mask])
        np.testing.assert_array_equal(some.times_ns, FOUR.sorted().times_ns[mask])

    @pytest.mark.parametrize("between", [(-0.3, 0.3), (1.0, 1.2), (-3.0, -2.5), (2.9, -2.9)])
    def test_its_laserscan_is_the_whole_one_with_beams_left_out(self, between: tuple[float, float]) -> None:
        count = 400
        whole = scan(
            [-0.9 * n - 0.45 for n in range(count)],
            [1 + n / 1000 for n in range(count)],
            time_increment_ns=250_000,
            duration_ns=100_000_000,
            lost_packets=0,
        )
        some = whole.select(between=between)
        assert 10 < len(some) < 120
        full, part = whole.to_laserscan(count), some.to_laserscan(count)
        assert part.stamp_ns == full.stamp_ns
        assert part.time_increment == full.time_increment
        assert part.angle_min == full.angle_min
        seen = np.isfinite(part.ranges)
        assert seen.sum() == len(some)
        np.testing.assert_array_equal(part.ranges[seen], full.ranges[seen])

    @pytest.mark.parametrize("mask", [[True], [1, 0, 1, 0], [[True] * 4]])
    def test_a_mask_that_is_none(self, mask: Any) -> None:
        with pytest.raises(InvalidValue, match="the mask must be bool"):
            FOUR.select(mask)


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
