"""Resampling a scan onto the even grid that ROS' ``sensor_msgs/LaserScan`` describes.

Scanners do not measure at equal steps, and the number of samples varies from turn to turn; SLAM packages
want neither. So resampling is a step of its own, taken when asked for: each sample goes to the nearest grid
angle, the nearest return wins where several meet, a bin whose beams all came back empty says ``no_return``,
and a bin that no beam fell into says NaN, since nothing is known about it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lidario.model import Scan

__all__ = ["LaserScan", "NoReturn", "resample"]

NoReturn = Literal["inf", "nan", "zero"]
_NO_RETURN = {"inf": math.inf, "nan": math.nan, "zero": 0.0}


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """The fields of ``sensor_msgs/LaserScan``, by the same names.

    Attributes:
        stamp_ns: Wall clock of the first ray in nanoseconds since the Unix epoch.
        frame_id: Name of the coordinate frame.
        angle_min: Angle of ``ranges[0]``, radians counter-clockwise.
        angle_max: Angle of ``ranges[-1]``.
        angle_increment: Step between neighbours, radians.
        time_increment: Seconds between neighbours. The device turns clockwise and the grid runs
            counter-clockwise, so this is negative.
        scan_time: Seconds a turn takes.
        range_min: Shortest range reported, metres.
        range_max: Longest range reported, metres.
        ranges: Metres, float32, shape (beams,).
        intensities: float32, shape (beams,), or (0,) where the format carries none.
    """

    stamp_ns: int
    frame_id: str
    angle_min: float
    angle_max: float
    angle_increment: float
    time_increment: float
    scan_time: float
    range_min: float
    range_max: float
    ranges: NDArray[np.float32]
    intensities: NDArray[np.float32]


def resample(
    scan: Scan,
    beams: int | None = None,
    *,
    frame_id: str = "laser",
    range_min: float = 0.05,
    range_max: float = 40.0,
    no_return: NoReturn = "inf",
    mount_yaw: float = 0.0,
) -> LaserScan:
    """Put `scan` on a grid of `beams` equal steps from -pi; the arguments are those of `Scan.to_laserscan`.

    Raises:
        ValueError: `beams` is not positive, or `no_return` is none of the three words.
    """
    count = len(scan) if beams is None else beams
    if count < 1:
        raise ValueError(f"a grid needs at least one beam, not {count}")
    if no_return not in _NO_RETURN:
        raise ValueError(f"no_return must be one of {', '.join(_NO_RETURN)}, not {no_return!r}")
    step = 2 * math.pi / count
    turned = scan.angles.astype(np.float64) + mount_yaw
    bins = np.rint((turned + math.pi) / step).astype(np.intp) % count
    hit = scan.valid & (scan.ranges >= range_min) & (scan.ranges <= range_max)

    ranges = np.full(count, np.nan, np.float32)
    ranges[bins[~hit]] = _NO_RETURN[no_return]
    # Far to near, so that the nearest return is written last.
    order = np.flatnonzero(hit)[np.argsort(scan.ranges[hit], kind="stable")[::-1]]
    ranges[bins[order]] = scan.ranges[order]

    if scan.intensities is None:
        intensities = np.zeros(0, np.float32)
    else:
        intensities = np.zeros(count, np.float32)
        intensities[bins[order]] = scan.intensities[order]
    turn = scan.duration_ns * 1e-9
    return LaserScan(
        stamp_ns=scan.wall_stamp_ns,
        frame_id=frame_id,
        angle_min=-math.pi,
        angle_max=-math.pi + step * (count - 1),
        angle_increment=step,
        time_increment=-turn / count,
        scan_time=turn,
        range_min=range_min,
        range_max=range_max,
        ranges=ranges,
        intensities=intensities,
    )
