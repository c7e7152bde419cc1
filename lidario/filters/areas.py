"""Filters that look where a return is in the robot's frame: in a box, in a polygon."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import moderate, shown, yes_or_no
from lidario.errors import InvalidValue
from lidario.filters.base import MaskFilter
from lidario.scans.measured import MeasuredSamples
from lidario.scans.points import Mount
from lidario.scans.samples import FloatArray

_ORIGIN: Final = Mount()


@dataclass(frozen=True, slots=True)
class BoxFilter(MaskFilter):
    """Takes out returns in a box, such as the robot's own body.

    Attributes:
        min_x: Metres forward of the robot's origin, where the box begins.
        max_x: Where it ends.
        min_y: Metres to the left, where it begins.
        max_y: Where it ends.
        mount: Where the lidar is on the robot.
        invert: Whether all returns outside of it are taken out instead.

    Raises:
        InvalidValue: A side is no number of metres up to 1e6, the box ends before it begins, or `mount` is no
            `Mount`.
    """

    min_x: float
    max_x: float
    min_y: float
    max_y: float
    mount: Mount = _ORIGIN
    invert: bool = False

    def __post_init__(self) -> None:
        for name in ("min_x", "max_x", "min_y", "max_y"):
            object.__setattr__(self, name, moderate(getattr(self, name), f"{name} of a box"))
        for axis, least, most in (("x", self.min_x, self.max_x), ("y", self.min_y, self.max_y)):
            if least > most:
                raise InvalidValue(f"min_{axis} {least:g} is above max_{axis} {most:g}")
        _check_place(self)

    def leaves_out(self, record: MeasuredSamples, /) -> NDArray[np.bool_]:
        x, y = _mounted(record, self.mount)
        inside = (x >= self.min_x) & (x <= self.max_x) & (y >= self.min_y) & (y <= self.max_y)
        return record.valid & ~inside if self.invert else inside


@dataclass(frozen=True, slots=True)
class PolygonFilter(MaskFilter):
    """Takes out returns in a polygon: the robot's own body, or an area that it shall not see.

    Inside is where a line outwards crosses the edges an odd number of times.

    Attributes:
        polygon: Its corners in order, each (x, y), metres in the robot's frame; the last one joins the first.
        mount: Where the lidar is on the robot.
        invert: Whether all returns outside of it are taken out instead.

    Raises:
        InvalidValue: There are less than three corners, one is not two numbers of metres up to 1e6, or `mount` is
            no `Mount`.
    """

    polygon: Iterable[tuple[float, float]]
    mount: Mount = _ORIGIN
    invert: bool = False

    def __post_init__(self) -> None:
        try:
            corners = tuple((moderate(x, "x of a corner"), moderate(y, "y of a corner")) for x, y in self.polygon)
        except (TypeError, ValueError):
            corners = ()
        if len(corners) < 3:
            raise InvalidValue(
                f"a polygon is three corners or more, each (x, y) in metres, not {shown(self.polygon)}"
            )
        object.__setattr__(self, "polygon", corners)
        _check_place(self)

    def leaves_out(self, record: MeasuredSamples, /) -> NDArray[np.bool_]:
        x, y = _mounted(record, self.mount)
        inside = np.zeros(len(record), np.bool_)
        corners = tuple(self.polygon)
        for (x1, y1), (x2, y2) in pairwise((*corners, corners[0])):
            # Whether the line to the right of a return crosses this edge. An edge may be nearly level: no division.
            left = (x - x1) * (y2 - y1) < (y - y1) * (x2 - x1)
            inside ^= ((y1 > y) != (y2 > y)) & (left if y2 > y1 else ~left)
        return record.valid & (~inside if self.invert else inside)


def _mounted(record: MeasuredSamples, mount: Mount) -> tuple[FloatArray, FloatArray]:
    """The samples in the robot's frame, metres; NaN without a return."""
    cos, sin = record.directions()
    x, y = record.ranges * cos, record.ranges * sin
    if mount.yaw:
        turned, across = math.cos(mount.yaw), math.sin(mount.yaw)
        x, y = x * turned - y * across, x * across + y * turned
    return x + mount.x, y + mount.y


def _check_place(of: BoxFilter | PolygonFilter) -> None:
    if not isinstance(of.mount, Mount):
        raise InvalidValue(f"mount is a Mount, not {shown(of.mount)}")
    object.__setattr__(of, "invert", yes_or_no(of.invert, "invert"))
