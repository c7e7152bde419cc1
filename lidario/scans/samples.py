"""Arithmetic on the samples of a scan: from the device's convention to that of robots, and which samples are meant.

Plain functions on arrays of shape (n,). `lidario.scans.scan` is the record whose properties and methods they serve.
"""

import math
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import finite, number, shown
from lidario.errors import InvalidValue

FloatArray = NDArray[np.float32]
_ArrayT = TypeVar("_ArrayT", bound=NDArray[np.generic])
_BEYOND_M: Final = 1e30  # farther than every range, and still a number in single precision
_ROUNDED: Final = 1e-6  # radians by which a turn may be exceeded that somebody has computed in single precision


def read_only(array: _ArrayT) -> _ArrayT:
    """The same array, made read-only, since every reader of a stream holds the same one."""
    array.setflags(write=False)
    return array


def radians_of(device_angles: FloatArray) -> FloatArray:
    """Radians counter-clockwise in [-pi, pi], of degrees clockwise in [0, 360)."""
    # 360 is added to degrees, where that is exact.
    radians = (device_angles > 180.0) * np.float32(360.0)
    radians -= device_angles
    radians *= math.pi / 180.0
    return read_only(radians)


def metres_of(device_distances: FloatArray) -> FloatArray:
    """Metres, NaN where nothing came back, of millimetres that are 0 there."""
    metres = device_distances / np.float32(1000)
    metres[device_distances <= 0] = np.nan
    return read_only(metres)


def check_radians(angle: float) -> None:
    """Refuse what is more than a turn: it is meant in degrees."""
    if abs(angle) > math.tau + _ROUNDED:
        raise InvalidValue(f"an angle is radians, at most a turn, not {angle:g}: use math.radians() for degrees")


def is_between(angles: FloatArray, between: tuple[float, float]) -> NDArray[np.bool_]:
    """Which angles lie from the first one counter-clockwise to the second, radians."""
    try:
        begin, end = (finite(angle, "an angle") for angle in between)
    except (TypeError, ValueError):
        raise InvalidValue(f"between is two finite angles in radians, not {shown(between)}") from None
    for angle in (begin, end):
        check_radians(angle)
    if end - begin >= math.tau:
        return np.ones(len(angles), np.bool_)
    first = (begin + math.pi) % math.tau - math.pi
    last = first + (end - begin) % math.tau
    inside = (angles >= first) & (angles <= last)
    if last >= math.pi:  # It goes on behind the lidar, where angles begin anew.
        inside |= angles <= last - math.tau
    return inside


def nearest_return(distances: FloatArray, among: NDArray[np.bool_] | None = None) -> int | None:
    """Index of the shortest distance above 0, of all or of those `among` them; None where nothing came back."""
    seen = distances > 0
    if among is not None:
        seen &= among
    # A third of the time of `numpy.nanargmin`.
    index = int(np.where(seen, distances, np.inf).argmin()) if len(seen) else -1
    return index if index >= 0 and seen[index] else None


def nearest_to(angles: FloatArray, angle: float, within: float) -> int | None:
    """Index of the angle nearest to `angle`, radians; None where it is not `within` that distance."""
    angle, within = finite(angle, "an angle"), number(within, "within")
    check_radians(angle)
    if within < 0:
        raise InvalidValue(f"within is a distance of 0 or more, not {within}")
    if not len(angles):
        return None
    away = np.abs((angles.astype(np.float64) - angle + math.pi) % math.tau - math.pi)
    index = int(np.argmin(away))
    return index if away[index] <= within else None


def in_single(metres: float) -> float:
    """The same figure where single precision holds it, which ranges and messages have; beyond that, infinity."""
    return math.copysign(math.inf, metres) if abs(metres) > _BEYOND_M else metres
