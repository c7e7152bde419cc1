"""Filters that look at a sample and its neighbours: veiling points, single points, a median.

Neighbours are counted in the order of measuring. In a scan the first sample follows on the last one, where these
are next to each other; in a sector nothing is known of what is beside it.
"""

import math
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import MODERATE, finite, moderate, shown, whole, yes_or_no
from lidario.errors import InvalidValue
from lidario.filters.base import Filter, MaskFilter, RecordT
from lidario.scans.measured import MeasuredSamples, with_distances
from lidario.scans.samples import FloatArray
from lidario.scans.scan import Scan

_ElementT = TypeVar("_ElementT", bound=np.generic)

MOST_WINDOW: Final = 50  # neighbours on each side; each costs some microseconds for each scan
MOST_MEDIAN: Final = 31
FAR_APART_COS: Final = math.cos(math.radians(30.0))
"""Samples that stand farther apart, because others are missing between them, are no neighbours."""


@dataclass(frozen=True, slots=True)
class ShadowsFilter(MaskFilter):
    """Takes out veiling points: those between an edge that is near and what stands far behind it.

    A beam that meets an edge is partly reflected by what is behind it, and its range is anything between the two.
    The rule is that of ``ScanShadowsFilter``: seen from a return, the line to a neighbour and the line to the lidar
    form an angle. Where it is smaller than `min_angle` or larger than `max_angle`, the two returns lie nearly one
    behind the other. Then of the returns beside this one, `neighbors` before and behind it, those that are farther
    away are taken out.

    Attributes:
        min_angle: Radians, from 0 to pi / 2.
        max_angle: Radians, from pi / 2 to pi.
        window: How many neighbours on each side are compared with a return.
        neighbors: How many on each side may be taken out.
        remove_shadow_start_point: Whether the return itself is taken out too.

    Raises:
        InvalidValue: An angle is not in its range, or a number of neighbours is not from 0 (`window`: 1) to 50.
    """

    min_angle: float = math.radians(10.0)
    max_angle: float = math.radians(170.0)
    window: int = 1
    neighbors: int = 1
    remove_shadow_start_point: bool = False

    def __post_init__(self) -> None:
        quarter = math.pi / 2
        for name, least, most in (("min_angle", 0.0, quarter), ("max_angle", quarter, math.pi)):
            angle = finite(getattr(self, name), name)
            if not least <= angle <= most:
                raise InvalidValue(f"{name} is radians from {least:.4g} to {most:.4g}, not {angle:g}")
            object.__setattr__(self, name, angle)
        _check_count(self, "window", 1, MOST_WINDOW)
        _check_count(self, "neighbors", 0, MOST_WINDOW)
        start = yes_or_no(self.remove_shadow_start_point, "remove_shadow_start_point")
        object.__setattr__(self, "remove_shadow_start_point", start)

    def leaves_out(self, record: MeasuredSamples, /) -> NDArray[np.bool_]:
        count, ranges = len(record), record.ranges
        # A return at the begin may be next to one at the end, `neighbors` further.
        closed = _is_closed(record, max(self.window, self.neighbors))
        cos, sin = (_beyond(each, self.window, closed, np.nan) for each in record.directions())
        far = _beyond(ranges, self.window, closed, np.nan)
        edges = np.zeros(count + self.window, np.bool_)
        least = math.cos(self.min_angle), math.sin(self.min_angle)
        most = math.cos(self.max_angle), math.sin(self.max_angle)
        for step in range(1, self.window + 1):
            other = slice(step, step + count)
            between = cos[:count] * cos[other] + sin[:count] * sin[other]
            across = np.abs(sin[:count] * cos[other] - cos[:count] * sin[other])
            near = between >= FAR_APART_COS
            for here, there, at in ((ranges, far[other], slice(count)), (far[other], ranges, other)):
                # The angle at `here`, as a vector: `up` is its sine, `along` its cosine, times the same length.
                up, along = there * across, here - there * between
                behind = along * least[1] > up * least[0]
                behind |= up * most[0] > along * most[1]
                edges[at] |= behind & near
        if closed:
            # What was found beyond the end is at the begin.
            edges[: self.window] |= edges[count:]
        return self._behind(record, edges[:count], closed)

    def _behind(self, record: MeasuredSamples, edges: NDArray[np.bool_], closed: bool) -> NDArray[np.bool_]:
        """Which returns are farther than an edge beside them."""
        ranges, reach = record.ranges, self.neighbors
        edge = np.where(edges, ranges, np.float32(np.inf))
        beside = _around(edge, reach, closed, np.inf)
        cos, sin = record.directions()
        following = cos[1:] * cos[:-1] + sin[1:] * sin[:-1]
        # In such small steps nothing in the window is far apart; a closed scan has one more, at its end.
        small = math.cos(math.radians(30.0) / max(reach, 1))
        is_dense = not closed or cos[0] * cos[-1] + sin[0] * sin[-1] >= small
        if is_dense and following.min(initial=1.0) >= small:
            nearest = _least(beside, 2 * reach + 1)
        else:
            cos_around, sin_around = (_around(each, reach, closed, np.nan) for each in (cos, sin))
            nearest = np.full_like(ranges, np.inf)
            for begin in range(2 * reach + 1):
                there = slice(begin, begin + len(ranges))
                is_near = cos * cos_around[there] + sin * sin_around[there] >= FAR_APART_COS
                nearest = np.minimum(nearest, np.where(is_near, beside[there], np.float32(np.inf)))
        out = nearest < ranges
        return out | edges if self.remove_shadow_start_point else out


@dataclass(frozen=True, slots=True)
class RadiusOutlierFilter(MaskFilter):
    """Takes out speckles: returns that have too few others near them, such as dust, rain and snow.

    The rule is that of the filter of this name in ``laser_filters``.

    Attributes:
        radius_search: How near another return must be, metres.
        min_neighbors: How many must be so near.
        window: Among how many samples before and behind it they are sought.

    Raises:
        InvalidValue: `radius_search` is no number from 0 to 1e6, `min_neighbors` none from 1 to 100, or
            `window` none from 1 to 50.
    """

    radius_search: float = 0.15
    min_neighbors: int = 1
    window: int = 3

    def __post_init__(self) -> None:
        radius = moderate(self.radius_search, "radius_search")
        if radius < 0:
            raise InvalidValue(f"radius_search is metres from 0 to {MODERATE:g}, not {radius:g}")
        object.__setattr__(self, "radius_search", radius)
        _check_count(self, "min_neighbors", 1, 2 * MOST_WINDOW)
        _check_count(self, "window", 1, MOST_WINDOW)

    def leaves_out(self, record: MeasuredSamples, /) -> NDArray[np.bool_]:
        count, window = len(record), self.window
        closed = _is_closed(record, window)
        cos, sin = record.directions()
        x, y = (_beyond(record.ranges * each, window, closed, np.nan) for each in (cos, sin))
        found = np.zeros(count + window, np.uint8)
        limit = self.radius_search * self.radius_search
        for step in range(1, window + 1):
            # Of ranges that only a damaged message has, the square is infinite, and so not near.
            with np.errstate(over="ignore"):
                dx, dy = x[:count] - x[step : step + count], y[:count] - y[step : step + count]
                near = dx * dx + dy * dy <= limit
            found[:count] += near
            found[step : step + count] += near
        if closed:
            found[:window] += found[count:]
        return record.valid & (found[:count] < self.min_neighbors)


@dataclass(frozen=True, slots=True)
class MedianFilter(Filter):
    """Gives each return the median of the ranges around it, so that single jumps and noise are less.

    Where a neighbour has no return, or is missing, the sample's own range counts in its place. Samples without a
    return stay without.

    Attributes:
        window: How many samples the median is of, with the one in the middle: odd, from 3 to 31.

    Raises:
        InvalidValue: `window` is something else.
    """

    window: int = 3

    def __post_init__(self) -> None:
        _check_count(self, "window", 3, MOST_MEDIAN)
        if not self.window % 2:
            raise InvalidValue(f"the window of a median is odd, not {self.window}")

    def __call__(self, record: RecordT, /) -> RecordT:
        """The same samples with other ranges."""
        return with_distances(record, lambda measured: (self._medians(measured), measured._left_out))  # noqa: SLF001

    def _medians(self, record: MeasuredSamples) -> FloatArray:
        own, count, reach = record.device_distances, len(record), self.window // 2
        closed = _is_closed(record, reach)
        cos, sin = record.directions()
        cos_around, sin_around = (_around(each, reach, closed, np.nan) for each in (cos, sin))
        around = _around(own, reach, closed, 0.0)
        rows = []
        for begin in range(self.window):
            if begin == reach:
                rows.append(own)
                continue
            there = slice(begin, begin + count)
            beside = cos * cos_around[there] + sin * sin_around[there] >= FAR_APART_COS
            beside &= around[there] > 0
            rows.append(np.where(beside, around[there], own))
        # The largest of what is left is moved to the end, until the one in the middle is there.
        for last in range(self.window - 1, reach - 1, -1):
            for at in range(last):
                low, high = rows[at], rows[at + 1]
                rows[at], rows[at + 1] = np.minimum(low, high), np.maximum(low, high)
        return np.where(own > 0, rows[reach], own)


def _is_closed(record: MeasuredSamples, window: int) -> bool:
    """Whether the first sample is a neighbour of the last one."""
    if not isinstance(record, Scan) or len(record) <= 2 * window:
        return False
    cos, sin = record.directions()
    return bool(cos[0] * cos[-1] + sin[0] * sin[-1] >= FAR_APART_COS)


def _beyond(values: NDArray[_ElementT], count: int, closed: bool, otherwise: float) -> NDArray[_ElementT]:
    """The values, and `count` more: the first ones again, or what stands for none."""
    more = values[:count] if closed else np.full(count, otherwise, values.dtype)
    return np.concatenate((values, more))


def _around(values: NDArray[_ElementT], count: int, closed: bool, otherwise: float) -> NDArray[_ElementT]:
    """The values, and `count` more on both sides."""
    less = values[len(values) - count :] if closed else np.full(count, otherwise, values.dtype)
    return np.concatenate((less, _beyond(values, count, closed, otherwise)))


def _least(values: FloatArray, wanted: int) -> FloatArray:
    """The least of each window of so many, by windows twice as long each time."""
    length = 1
    while length < wanted:
        step = min(length, wanted - length)
        values = np.minimum(values[:-step], values[step:])
        length += step
    return values


def _check_count(of: object, name: str, least: int, most: int) -> None:
    found = whole(getattr(of, name), name)
    if not least <= found <= most:
        raise InvalidValue(f"{name} is a whole number from {least} to {most}, not {shown(found)}")
    object.__setattr__(of, name, found)
