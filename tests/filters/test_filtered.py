"""What every filter keeps: times, gaps, the grid of a LaserScan; and in which order they may stand."""

import math
import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario import InvalidValue, Mount, Scan, Velocity, filters
from lidario.filters import (
    AngularBoundsFilter,
    BoxFilter,
    Filter,
    IntensityFilter,
    MaskFilter,
    MedianFilter,
    PolygonFilter,
    RadiusOutlierFilter,
    RangeFilter,
    ShadowsFilter,
)
from lidario.network.messages import encode_scan, parse_scan
from lidario.scans.measured import MeasuredSamples, changed
from lidario.testing import make_scan, make_sector
from tests.filters.test_rules import scans
from tests.support.cases import CASES, Case
from tests.support.kept import kept_without
from tests.support.samples import one_a_parser

SINGLE: list[Filter] = [
    AngularBoundsFilter([(-1.0, 2.0), (2.5, -2.5)]),
    AngularBoundsFilter([(0.1, 0.4)], invert=True),
    RangeFilter(0.5, 4.0),
    IntensityFilter(20, 200),
    BoxFilter(-0.5, 1.5, -0.5, 0.5, mount=Mount(0.1, 0.2, 0.3)),
    PolygonFilter([(0, 0), (2, 0), (0, 2)]),
]
EVERY: list[Filter] = [*SINGLE, ShadowsFilter(), RadiusOutlierFilter(), MedianFilter()]
FILTERS = st.lists(st.sampled_from(EVERY), max_size=5)


def room(count: int = 360, **about: Any) -> Scan:
    # Each in the middle of its beam.
    angles = (np.arange(count) + 0.5) / count * math.tau - math.pi
    ranges = 2 + np.sin(3 * angles)
    ranges[::10] = np.nan
    return make_scan(angles, ranges, intensities=np.arange(count) % 256, **about)


@given(scans(), FILTERS)
def test_never_more_points_and_the_same_times(scan: Scan, several: list[Filter]) -> None:
    made = scan.filtered(*several)
    assert len(made) == len(scan)
    assert not (made.valid & ~scan.valid).any()
    assert not (made.valid & made.left_out).any()
    assert len(made.points()) <= len(scan.points())
    for name in ("times_ns", "device_angles", "angles", "intensities"):
        np.testing.assert_array_equal(getattr(made, name), getattr(scan, name))
    for name in ("seq", "stamp_ns", "duration_ns", "lost_packets", "dropped_before", "rpm", "time_increment_ns"):
        assert getattr(made, name) == getattr(scan, name)
    # Each once is enough, where only one sample at a time is looked at.
    single = [each for each in several if each in SINGLE]
    once = scan.filtered(*single)
    np.testing.assert_array_equal(once.filtered(*single).left_out, once.left_out)


@given(scans(), st.permutations(SINGLE))
def test_the_order_of_those_that_look_at_one_sample_does_not_matter(scan: Scan, several: list[Filter]) -> None:
    one, other = scan.filtered(*SINGLE), scan.filtered(*several)
    np.testing.assert_array_equal(one.left_out, other.left_out)
    np.testing.assert_array_equal(one.device_distances, other.device_distances)


@given(scans(), FILTERS)
def test_a_sorted_scan_is_filtered_in_the_order_of_measuring(scan: Scan, several: list[Filter]) -> None:
    expected, found = scan.filtered(*several).sorted(), scan.sorted().filtered(*several)
    for name in ("device_angles", "device_distances", "left_out", "times_ns"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    if len(scan):
        np.testing.assert_array_equal(found.to_laserscan().ranges, expected.to_laserscan().ranges)


@pytest.mark.parametrize(("word", "value"), [("nan", math.nan), ("inf", math.inf), ("zero", 0.0)])
def test_a_filtered_beam_of_a_laserscan_is_what_was_chosen(word: Any, value: float) -> None:
    scan = room()
    filtered = scan.filtered(AngularBoundsFilter([(-0.5, 0.5)], invert=True))
    before, after = scan.to_laserscan(), filtered.to_laserscan(filtered=word)
    inside = np.abs((np.arange(360) + 0.5) / 360 * math.tau - math.pi) > math.pi - 0.5
    np.testing.assert_array_equal(after.ranges[inside], np.float32(value))
    np.testing.assert_array_equal(after.ranges[~inside], before.ranges[~inside])
    assert np.isinf(before.ranges[inside]).any()
    for name in ("stamp_ns", "angle_min", "angle_increment", "time_increment", "scan_time"):
        assert getattr(after, name) == getattr(before, name)


def test_any_other_sample_of_a_beam_says_more_than_a_filtered_one() -> None:
    # Three beams of 120 degrees: filtered and no return; filtered and a return; filtered alone.
    degrees = np.array([10, 20, 130, 140, 250])
    scan = make_scan(-np.radians(degrees), [1.0, np.nan, 1.0, 3.0, 1.0])
    ranges = scan.filtered(RangeFilter(2.0)).to_laserscan(3, order="measured", no_return="inf").ranges
    np.testing.assert_array_equal(ranges, np.array([math.inf, 3.0, math.nan], np.float32))


@one_a_parser([case for case in CASES if case.make_format().longest > 5])
def test_lost_packets_and_gaps_are_as_before(case: Case) -> None:
    middle = (case.turns[1][0].packet + case.turns[1][-1].packet) // 2
    scan = next(each for each in kept_without(case, range(middle, middle + 2)).scans if each.lost_packets)
    filtered = scan.filtered(*EVERY)
    assert filtered.left_out.any()
    assert filtered.lost_packets == scan.lost_packets
    np.testing.assert_array_equal(filtered.times_ns, scan.times_ns)
    before, after = scan.to_laserscan(), filtered.to_laserscan()
    assert (after.stamp_ns, after.time_increment) == (before.stamp_ns, before.time_increment)
    moved = filtered.points(motion=Velocity(1.0, 0.0, 1.0))
    assert set(moved.times_ns.tolist()) <= set(scan.points().times_ns.tolist())


def test_a_selection_and_a_copy_know_what_was_filtered() -> None:
    scan = room().filtered(RangeFilter(1.5))
    assert scan.left_out.any()
    half = scan.select(between=(0.0, math.pi))
    np.testing.assert_array_equal(half.left_out, scan.left_out[np.isin(scan.times_ns, half.times_ns)])
    np.testing.assert_array_equal(changed(scan, dropped_before=3).left_out, scan.left_out)
    absent = scan.select(~scan.left_out)
    assert not absent.left_out.any()
    assert len(absent) == len(scan) - np.count_nonzero(scan.left_out)
    assert set(absent.times_ns.tolist()) <= set(scan.times_ns.tolist())
    assert scan.nearest() == scan.filtered().nearest()
    nearest = scan.nearest()
    assert nearest is not None
    assert nearest.range >= 1.5


def test_a_selection_that_is_filtered_keeps_the_times_of_the_whole_scan() -> None:
    """Its own angles no longer tell them."""
    part = room().select(between=(0.5, 0.8))
    made = part.filtered(RangeFilter(0.0, 2.9))
    assert made.left_out.any()
    np.testing.assert_array_equal(made.times_ns, part.times_ns)
    before, after = part.to_laserscan(90), made.to_laserscan(90)
    assert (after.stamp_ns, after.time_increment) == (before.stamp_ns, before.time_increment)


def test_a_scan_of_another_machine_tells_it_too() -> None:
    for scan in (room(), room(361), make_scan([0.1], [1.0]), make_scan([], [])):
        sent = scan.filtered(RangeFilter(1.5))
        found = parse_scan(encode_scan(sent), 0)
        assert found is not None
        np.testing.assert_array_equal(found.left_out, sent.left_out)
        np.testing.assert_array_equal(found.device_distances, sent.device_distances)


def test_nothing_to_take_out_costs_no_copy() -> None:
    scan = room()
    assert scan.filtered(RangeFilter(0.1), BoxFilter(-0.1, 0.1, -0.1, 0.1)) is scan
    assert not scan.left_out.any()
    assert not scan.left_out.flags.writeable


@pytest.mark.parametrize("far", [1e31, 1e300, math.inf])
def test_thresholds_beyond_single_precision(far: float) -> None:
    scan = room()
    assert scan.filtered(RangeFilter(-far, far)) is scan
    assert not scan.filtered(RangeFilter(far)).valid.any()


def test_ranges_near_the_largest_number_are_far_from_each_other_and_warn_of_nothing() -> None:
    scan = make_scan([-0.01, 0.0, 0.01, 3.1], [1.0, 1e30, 1.0, 1e30])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = scan.filtered(RadiusOutlierFilter(0.15, 1, 3))
    assert found.sorted().left_out.tolist() == [False, True, False, True]


def test_a_sector() -> None:
    sector = make_sector([-0.1, -0.2, -0.3], [0.4, 2.0, 2.0])
    made = sector.filtered(RangeFilter(1.0), MedianFilter())
    assert made.left_out.tolist() == [True, False, False]
    assert (made.seq, made.index, made.times_ns.tolist()) == (sector.seq, sector.index, sector.times_ns.tolist())
    nearest = made.nearest()
    assert nearest is not None
    assert nearest.range == pytest.approx(2.0)


def test_a_filter_may_use_its_mask_again() -> None:
    class Alternating(MaskFilter):
        def __init__(self) -> None:
            self.mask = np.zeros(360, np.bool_)

        def leaves_out(self, record: MeasuredSamples, /) -> Any:
            self.mask[::2] = ~self.mask[::2]
            self.mask[1::2] = ~self.mask[::2]
            return self.mask

    scan, each = room(), Alternating()
    first, second = scan.filtered(each), scan.filtered(each)
    assert (first.left_out ^ second.left_out).all()
    assert not first.left_out.flags.writeable


@pytest.mark.parametrize(
    "mask", [np.array([0, 0, 1]), np.array([1.0, 0.0, 0.0]), np.array([True, False]), [True, False, False]]
)
def test_a_mask_that_is_not_one_of_samples_is_refused(mask: Any) -> None:
    class Wrong(MaskFilter):
        def leaves_out(self, record: MeasuredSamples, /) -> Any:
            return mask

    scan = make_scan([-0.1, 0.0, 0.1], 1.0)
    with pytest.raises(InvalidValue, match=r"bool, one value a sample, shape \(3,\)"):
        scan.filtered(Wrong())
    assert scan.valid.all()


def test_a_function_of_the_user_is_a_filter() -> None:
    class Every(MaskFilter):
        def leaves_out(self, record: MeasuredSamples, /) -> Any:
            return np.arange(len(record)) % 2 == 0

    scan = room()
    assert scan.filtered(Every()).left_out.sum() == 180
    assert len(scan.filtered(lambda each: each.select(each.ranges < 2))) < 360
    wrong: Any
    for wrong in (lambda each: None, lambda each: each.ranges, 3, None):
        with pytest.raises(InvalidValue, match="filter"):
            scan.filtered(wrong)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: AngularBoundsFilter([(0, 90)]), "math.radians"),
        (lambda: AngularBoundsFilter((0, 1)), "list of"),  # type: ignore[arg-type]
        (lambda: RangeFilter(2, 1), "above"),
        (lambda: BoxFilter(1, 0, 0, 1), "min_x 1 is above max_x 0"),
        (lambda: BoxFilter(0, 1, 0, 1, mount=(0, 0, 0)), "mount is a Mount"),  # type: ignore[arg-type]
        (lambda: BoxFilter(0, 1e7, 0, 1), "at most 1e\\+06"),
        (lambda: BoxFilter(0, 1, 0, 1, mount=Mount(x=1e300)), "at most 1e\\+06"),
        (lambda: PolygonFilter([(0, 0), (1, 1)]), "three corners"),
        (lambda: ShadowsFilter(min_angle=10), "radians from 0 to 1.571"),
        (lambda: ShadowsFilter(window=0), "from 1 to 50"),
        (lambda: MedianFilter(4), "odd"),
        (lambda: RadiusOutlierFilter(-1), "from 0 to 1e\\+06"),
    ],
)
def test_a_wrong_argument_is_told_where_it_is_given(make: Any, text: str) -> None:
    with pytest.raises(InvalidValue, match=text):
        make()


def test_every_filter_is_there() -> None:
    names = {name for name in filters.__all__ if name.endswith("Filter")} - {"Filter", "MaskFilter"}
    assert {type(each).__name__ for each in EVERY} == names
