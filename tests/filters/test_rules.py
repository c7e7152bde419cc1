"""Each filter beside a scalar reference, and beside the compiled filters of ROS on the same scans."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lidario import Mount, Scan, Sector
from lidario.filters import (
    AngularBoundsFilter,
    BoxFilter,
    IntensityFilter,
    MaskFilter,
    MedianFilter,
    PolygonFilter,
    RadiusOutlierFilter,
    RangeFilter,
    ShadowsFilter,
)
from lidario.testing import make_scan, make_sector
from tests.reference import filters as reference

DATA = Path(__file__).with_name("laser_filters.npz")
ANGLE = st.floats(-6.28, 6.28)


def metres_of(draw: st.DrawFn, count: int) -> NDArray[np.float64]:
    """Walls with jumps between them, noise, single returns, and holes (0)."""
    chance = np.random.default_rng(draw(st.integers(0, 10**6)))
    walls = np.repeat(chance.uniform(0.3, 6.0, count), chance.integers(1, 9, count))[:count]
    metres = walls + chance.normal(0.0, draw(st.sampled_from([0.0, 0.01, 0.3])), count)
    alone = chance.random(count) < 0.1
    metres[alone] = chance.uniform(0.1, 6.0, np.count_nonzero(alone))
    return np.where(chance.random(count) < 0.1, 0.0, np.maximum(metres, 0.05))


@st.composite
def scans(draw: st.DrawFn) -> Scan:
    """Evenly measured, with holes and jumps; some with samples missing, or of a part of the circle."""
    count = draw(st.one_of(st.integers(0, 5), st.integers(12, 90)))
    ranges = metres_of(draw, count)
    # No two are 30 degrees apart, where rounding decides whether they are neighbours.
    degrees = np.arange(count) * (draw(st.sampled_from([89.9, 269.7, 359.3])) / max(count, 1))
    keep = np.ones(count, np.bool_)
    if draw(st.booleans()):
        begin = draw(st.integers(0, max(count - 1, 0)))
        keep[begin : begin + draw(st.integers(0, 30))] = False
    metres = ranges[keep]
    strengths = np.arange(count)[keep] * 7 % 256
    found = np.where(metres > 0, metres, np.nan)
    return make_scan(-np.radians(degrees[keep]) % math.tau, found, intensities=strengths)


@st.composite
def sectors(draw: st.DrawFn) -> Sector:
    count = draw(st.integers(1, 40))
    metres = metres_of(draw, count)
    angles = -np.radians(0.5 + np.arange(count) * (44 / count))
    return make_sector(angles, np.where(metres > 0, metres, np.nan), degrees=45)


def known(record: Scan | Sector) -> tuple[list[float], list[float | None]]:
    ranges = [float(each) if each == each else None for each in record.ranges]
    return [float(each) for each in record.angles], ranges


def agrees(record: Scan | Sector, each: MaskFilter, expected: reference.Verdict) -> None:
    """The filter takes out what the reference does; where rounding decides, either is right."""
    sure = np.array([verdict is not None for verdict in expected], np.bool_)
    wanted = np.array([bool(verdict) for verdict in expected], np.bool_)
    np.testing.assert_array_equal(each.leaves_out(record)[sure], wanted[sure])
    made = each(record)
    np.testing.assert_array_equal(made.left_out, each.leaves_out(record))
    np.testing.assert_array_equal(made.valid, record.valid & ~made.left_out)
    np.testing.assert_array_equal(made.device_distances[made.valid], record.device_distances[made.valid])


@given(scans(), st.lists(st.tuples(ANGLE, ANGLE), max_size=3), st.booleans())
def test_angular_bounds(scan: Scan, windows: list[tuple[float, float]], invert: bool) -> None:
    inside = [reference.either(*(reference.in_window(a, *w) for w in windows)) for a in known(scan)[0]]
    expected = inside if invert else [reference.opposite(each) for each in inside]
    agrees(scan, AngularBoundsFilter(windows, invert=invert), expected)


@given(scans(), st.floats(0, 6), st.floats(0, 6))
def test_range(scan: Scan, one: float, two: float) -> None:
    lower, upper = min(one, two), max(one, two)
    expected = [
        False if each is None else reference.either(reference.less(each, lower), reference.less(upper, each))
        for each in known(scan)[1]
    ]
    agrees(scan, RangeFilter(lower, upper), expected)


@given(scans(), st.floats(-20, 300), st.floats(-20, 300))
def test_intensity(scan: Scan, one: float, two: float) -> None:
    lower, upper = min(one, two), max(one, two)
    assert scan.intensities is not None
    expected: reference.Verdict = [
        hit and not lower <= strength <= upper
        for hit, strength in zip(scan.valid.tolist(), scan.intensities.tolist(), strict=True)
    ]
    agrees(scan, IntensityFilter(lower, upper), expected)
    agrees(scan, IntensityFilter(), [False] * len(scan))


@given(scans(), st.tuples(*[st.floats(-4, 4)] * 4), st.tuples(*[st.floats(-3, 3)] * 3), st.booleans())
def test_box(
    scan: Scan, sides: tuple[float, float, float, float], mount: tuple[float, float, float], invert: bool
) -> None:
    box = (min(sides[:2]), max(sides[:2]), min(sides[2:]), max(sides[2:]))
    inside = [
        None if r is None else reference.in_box(reference.place(a, r, mount), box)
        for a, r in zip(*known(scan), strict=True)
    ]
    agrees(scan, BoxFilter(*box, mount=Mount(*mount), invert=invert), of_returns(scan, inside, invert))


CORNERS = st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=3, max_size=7)


@given(scans(), CORNERS, st.tuples(*[st.floats(-3, 3)] * 3), st.booleans())
def test_polygon(
    scan: Scan, corners: list[tuple[float, float]], mount: tuple[float, float, float], invert: bool
) -> None:
    inside = [
        None if r is None else reference.in_polygon(reference.place(a, r, mount), corners)
        for a, r in zip(*known(scan), strict=True)
    ]
    agrees(scan, PolygonFilter(corners, Mount(*mount), invert), of_returns(scan, inside, invert))


def of_returns(scan: Scan, inside: reference.Verdict, invert: bool) -> reference.Verdict:
    """Where nothing came back, nothing is taken out."""
    found = [reference.opposite(each) for each in inside] if invert else inside
    return [each if hit else False for each, hit in zip(found, scan.valid.tolist(), strict=True)]


@given(
    st.one_of(scans(), sectors()),
    st.floats(0, math.pi / 2),
    st.floats(math.pi / 2, math.pi),
    st.integers(1, 4),
    st.integers(0, 5),
    st.booleans(),
)
def test_shadows(record: Scan | Sector, least: float, most: float, window: int, reach: int, start: bool) -> None:
    whole = isinstance(record, Scan)
    expected = reference.shadows(*known(record), least, most, window, reach, start, whole)
    agrees(record, ShadowsFilter(least, most, window, reach, start), expected)


@pytest.mark.parametrize("reach", [1, 3])
@pytest.mark.parametrize("count", [5, 30])
def test_no_shadow_falls_over_a_gap(reach: int, count: int) -> None:
    degrees = np.concatenate((np.arange(count), 100 + np.arange(count)))
    metres = np.full(2 * count, 5.0)
    metres[count - 1] = 1.0
    scan = make_scan(-np.radians(degrees), metres)
    taken = ShadowsFilter(neighbors=reach).leaves_out(scan)
    assert np.flatnonzero(taken).tolist() == list(range(count - 1 - reach, count - 1))


@given(st.one_of(scans(), sectors()), st.floats(0, 2), st.integers(1, 4), st.integers(1, 5))
def test_radius_outliers(record: Scan | Sector, radius: float, wanted: int, window: int) -> None:
    expected = reference.radius_outliers(*known(record), radius, wanted, window, isinstance(record, Scan))
    agrees(record, RadiusOutlierFilter(radius, wanted, window), expected)


@given(st.one_of(scans(), sectors()), st.sampled_from([3, 5, 7, 15]))
def test_median(record: Scan | Sector, window: int) -> None:
    made = MedianFilter(window)(record)
    expected = reference.medians(*known(record), window, isinstance(record, Scan))
    assert [float(each) if each == each else None for each in made.ranges] == expected
    assert not made.left_out.any()


def golden() -> list[tuple[str, MaskFilter]]:
    made: dict[str, Callable[..., MaskFilter]] = {
        "shadows": lambda least, most, window, reach, start: ShadowsFilter(
            least, most, int(window), int(reach), bool(start)
        ),
        "radius": lambda radius, wanted, window: RadiusOutlierFilter(radius, int(wanted), int(window)),
    }
    with np.load(DATA) as data:
        names = [name.rpartition("_")[0] for name in data if name.endswith("_0") and name[0] != "d"]
    return [(name, made[name.partition("_")[0]](*map(float, name.split("_")[1:]))) for name in names]


@pytest.mark.parametrize(("name", "each"), golden(), ids=lambda value: value if isinstance(value, str) else "")
@pytest.mark.parametrize("number", range(4))
def test_as_the_filters_of_ros(name: str, each: MaskFilter, number: int) -> None:
    with np.load(DATA) as data:
        metres: NDArray[Any] = data[f"distances_{number}"] / 1000.0
        expected = np.unpackbits(data[f"{name}_{number}"], count=len(metres)).astype(np.bool_)
    angles = -np.radians(np.arange(len(metres)) * 270 / len(metres))
    scan = make_scan(angles, np.where(metres > 0, metres, np.nan))
    # Single precision decides where an angle is the limit itself.
    differing = int(np.count_nonzero(each.leaves_out(scan) != expected))
    assert np.count_nonzero(expected) > 30
    assert differing <= 2
