"""Scans made by hand: for tests of what a program does with a scan, without any lidar."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidario import InvalidValue, Scan

__all__ = ["make_scan"]

ArrayT = TypeVar("ArrayT", bound=NDArray[np.generic])

_STAMP_NS = 1_000_000_000
_WALL_STAMP_NS = 1_700_000_000_000_000_000


def make_scan(
    angles: ArrayLike,
    ranges: ArrayLike,
    *,
    intensities: ArrayLike | None = None,
    rpm: float = 600.0,
    stamp_ns: int = _STAMP_NS,
    wall_stamp_ns: int = _WALL_STAMP_NS,
    seq: int = 0,
    dropped_before: int = 0,
    lost_packets: int = 0,
    mode: str = "made",
    max_range: float = 0.0,
) -> Scan:
    """A scan with these samples.

    ::

        scan = make_scan([-0.1, 0.0, 0.1], [1.2, 0.4, 1.3])
        assert scan.nearest().range == pytest.approx(0.4)

        empty = make_scan(np.linspace(-np.pi, np.pi, 360, endpoint=False), np.nan)

    The samples are put into the order in which a lidar measures them: clockwise, beginning ahead. So
    ``scan.ranges`` has another order than `ranges`, unless that is so ordered; ``scan.sorted()`` has ascending
    angles.

    Args:
        angles: Radians counter-clockwise, 0 ahead; shape (n,).
        ranges: Metres; NaN or infinite where nothing comes back; shape (n,), or one number for all.
        intensities: 0 to 255; shape (n,), or one number for all; None for a lidar that tells none.
        rpm: Revolutions a minute; the samples divide the time of one revolution evenly.
        stamp_ns: When the first sample was measured.
        wall_stamp_ns: The same since the Unix epoch.
        seq: As in `Scan`, and so are the following ones.
        dropped_before: Scans that the reader missed before.
        lost_packets: How many packets are missing.
        mode: Name of the scan mode.
        max_range: Metres; 0 for a device that does not say.

    Raises:
        InvalidValue: The shapes do not fit together, an angle is not finite, a range is negative, an intensity is
            not from 0 to 255, or `rpm` is not positive.
    """
    given = np.atleast_1d(np.asarray(angles, np.float64))
    try:
        metres = np.broadcast_to(np.asarray(ranges, np.float64), given.shape)
        strengths = None if intensities is None else np.broadcast_to(np.asarray(intensities), given.shape)
    except ValueError:
        raise InvalidValue(
            f"there are {given.size} angles; ranges and intensities must be as many, or one number"
        ) from None
    if given.ndim != 1 or not np.isfinite(given).all():
        raise InvalidValue("angles are finite radians, in an array of shape (n,)")
    if (metres < 0).any():
        raise InvalidValue("ranges are metres from 0 on, or NaN where nothing comes back")
    if strengths is not None and (not (strengths >= 0).all() or not (strengths <= 255).all()):
        raise InvalidValue("intensities are numbers from 0 to 255")
    if not 0.0 < rpm < math.inf:
        raise InvalidValue(f"rpm is a positive number of revolutions a minute, not {rpm}")
    degrees = (-np.degrees(given)) % 360.0
    clockwise = degrees.astype(np.float32)
    clockwise[clockwise >= 360.0] = 0.0  # a hair below 360 becomes 360 in float32
    order = np.argsort(clockwise, kind="stable")
    millimetres = np.where(np.isfinite(metres), metres * 1000.0, 0.0).astype(np.float32)
    duration_ns = round(60e9 / rpm)
    return Scan(
        device_angles=_read_only(clockwise[order]),
        device_distances=_read_only(millimetres[order]),
        intensities=None if strengths is None else _read_only(strengths[order].astype(np.uint8)),
        stamp_ns=stamp_ns,
        wall_stamp_ns=wall_stamp_ns,
        time_increment_ns=duration_ns // max(1, given.size),
        duration_ns=duration_ns,
        rpm=rpm,
        seq=seq,
        dropped_before=dropped_before,
        lost_packets=lost_packets,
        mode=mode,
        max_range=max_range,
    )


def _read_only(array: ArrayT) -> ArrayT:
    """As the arrays of every scan are."""
    array.setflags(write=False)
    return array
