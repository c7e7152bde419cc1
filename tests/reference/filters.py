"""Filters of scans, a sample at a time in plain Python, written from the rules that `docs/filters.md` states.

A sample is an angle (radians, counter-clockwise) and a range (metres, None where nothing came back). Where a result
hangs on less than `MARGIN` it is None: rounding decides there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

MARGIN = 1e-4
FAR_APART = math.radians(30)

Ranges = Sequence[float | None]
Verdict = list[bool | None]


def difference(one: float, two: float) -> float:
    """Between two angles, from 0 to pi."""
    return abs((one - two + math.pi) % math.tau - math.pi)


def less(one: float, two: float) -> bool | None:
    """Whether one is less than the other; None where they are nearly the same."""
    return None if abs(one - two) < MARGIN else one < two


def either(*found: bool | None) -> bool | None:
    """True where one of them is, None where one of them may be."""
    return True if True in found else None if None in found else False


def opposite(found: bool | None) -> bool | None:
    return None if found is None else not found


def in_window(angle: float, begin: float, end: float) -> bool | None:
    """Whether an angle is met on the way from `begin` counter-clockwise to `end`."""
    if end - begin >= math.tau:
        return True
    if min(difference(angle, begin), difference(angle, end)) < MARGIN:
        return None
    if begin != end and difference(begin, end) < MARGIN:
        return None  # nothing, or all of the circle
    turned = angle
    while turned < begin:
        turned += math.tau
    while turned - math.tau >= begin:
        turned -= math.tau
    last = end
    while last < begin:
        last += math.tau
    while last - math.tau >= begin:
        last -= math.tau
    return turned < last


def place(angle: float, distance: float, mount: tuple[float, float, float]) -> tuple[float, float]:
    """Where a return is in the robot's frame."""
    x, y, yaw = mount
    return x + distance * math.cos(angle + yaw), y + distance * math.sin(angle + yaw)


def in_box(point: tuple[float, float], box: tuple[float, float, float, float]) -> bool | None:
    """Whether a point is in a box: min_x, max_x, min_y, max_y."""
    x, y = point
    outside = either(less(x, box[0]), less(box[1], x), less(y, box[2]), less(box[3], y))
    return opposite(outside)


def in_polygon(point: tuple[float, float], corners: Sequence[tuple[float, float]]) -> bool | None:
    """Whether edges that cross each other go round a point an odd number of times, by the angles they turn."""
    x, y = point
    crossed = 0
    for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if distance_to_edge(x, y, x1, y1, x2, y2) < MARGIN:
            return None
        if abs(y1 - y) < MARGIN or abs(y2 - y) < MARGIN:
            return None  # a line to the side would meet a corner
        if (y1 < y) != (y2 < y):
            at = x1 + (x2 - x1) * (y - y1) / (y2 - y1)
            crossed += at > x
    return crossed % 2 == 1


def distance_to_edge(x: float, y: float, x1: float, y1: float, x2: float, y2: float) -> float:
    length = math.hypot(x2 - x1, y2 - y1)
    along = 0.0 if length < MARGIN / 100 else ((x - x1) * (x2 - x1) + (y - y1) * (y2 - y1)) / length**2
    along = min(1.0, max(0.0, along))
    return math.hypot(x - x1 - along * (x2 - x1), y - y1 - along * (y2 - y1))


def neighbors(angles: Sequence[float], index: int, reach: int, whole: bool, least: int | None = None) -> list[int]:
    """Samples up to `reach` before and behind one; a scan that is closed goes on at its other end."""
    count = len(angles)
    closed = whole and count > 2 * (reach if least is None else least)
    closed = closed and difference(angles[0], angles[-1]) <= FAR_APART
    found = []
    for step in (*range(-reach, 0), *range(1, reach + 1)):
        at = index + step
        if closed:
            at %= count
        if 0 <= at < count:
            found.append(at)
    return found


def shadows(
    angles: Sequence[float],
    ranges: Ranges,
    min_angle: float,
    max_angle: float,
    window: int,
    reach: int,
    start: bool,
    whole: bool = True,
) -> Verdict:
    """Which samples are taken out as veiling points."""
    out: Verdict = [False] * len(ranges)
    most = max(window, reach)
    for index, here in enumerate(ranges):
        if here is None:
            continue
        edge: list[bool | None] = []
        for at in neighbors(angles, index, window, whole, most):
            there, between = ranges[at], difference(angles[index], angles[at])
            if there is None or between > FAR_APART + MARGIN:
                continue
            # At this return, between the line to the lidar and that to its neighbour.
            along, across = here - there * math.cos(between), there * math.sin(between)
            angle = math.atan2(across, along)
            sure = math.hypot(along, across) > 1e-3 and between > 1e-3 and between < FAR_APART - MARGIN
            verdict = either(less(angle, min_angle), less(max_angle, angle))
            edge.append(verdict if sure else None)
        is_edge = either(*edge)
        for at in neighbors(angles, index, reach, whole, most):
            beside = ranges[at]
            if beside is not None and beside > here and difference(angles[index], angles[at]) <= FAR_APART:
                out[at] = either(out[at], is_edge)
        if start:
            out[index] = either(out[index], is_edge)
    return out


def radius_outliers(
    angles: Sequence[float], ranges: Ranges, radius: float, wanted: int, window: int, whole: bool = True
) -> Verdict:
    """Which samples have too few others near them."""
    out: Verdict = []
    for index, here in enumerate(ranges):
        if here is None:
            out.append(False)
            continue
        x, y = place(angles[index], here, (0, 0, 0))
        near: list[bool | None] = []
        for at in neighbors(angles, index, window, whole):
            there = ranges[at]
            if there is not None:
                other = place(angles[at], there, (0, 0, 0))
                near.append(less(math.hypot(x - other[0], y - other[1]), radius))
        sure, possible = near.count(True), near.count(True) + near.count(None)
        out.append(True if possible < wanted else False if sure >= wanted else None)
    return out


def medians(angles: Sequence[float], ranges: Ranges, window: int, whole: bool = True) -> list[float | None]:
    """The range of each sample behind a median of so many."""
    found: list[float | None] = []
    reach = window // 2
    for index, here in enumerate(ranges):
        if here is None:
            found.append(None)
            continue
        values = [here]
        for at in neighbors(angles, index, reach, whole):
            there = ranges[at]
            beside = there is not None and difference(angles[index], angles[at]) <= FAR_APART
            values.append(there if beside and there is not None else here)
        values += [here] * (window - len(values))
        found.append(sorted(values)[reach])
    return found
