"""A scan as ``sensor_msgs/PointCloud2``: every return with its place, its intensity and its time.

Unlike a LaserScan it needs no grid: each sample keeps its own angle and its own time. The fields are ``x``, ``y``,
``z`` (float32, metres), ``intensity`` (float32) and ``t`` (uint32, nanoseconds after the stamp of the message,
which is that of the first return).
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import finite, shown, text_of
from lidario.errors import InvalidValue
from lidario.scans.cdr import CdrWriter
from lidario.scans.scan import Scan

POINT: Final = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("t", "<u4")])
"""One point as it is stored."""

_FLOAT32: Final = 7
_UINT32: Final = 6
"""Numbers of the types in ``sensor_msgs/PointField``."""
_LONGEST_NS: Final = (1 << 32) - 1


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud2:
    """The fields of ``sensor_msgs/PointCloud2`` that differ from message to message.

    Attributes:
        stamp_ns: Wall clock of the first point, nanoseconds since the Unix epoch.
        frame_id: Name of the coordinate frame.
        points: Records of `POINT`, shape (n,).
    """

    stamp_ns: int
    frame_id: str
    points: NDArray[np.void]

    def to_cdr(self) -> bytes:
        """The message as ROS 2 sends and stores it: CDR, lowest byte first."""
        head = CdrWriter()
        head.header(self.stamp_ns, self.frame_id)
        head.uint32(1)  # height
        head.uint32(len(self.points))
        fields = dict(POINT.fields or {})
        head.uint32(len(fields))
        for name, (_, offset, *_) in fields.items():
            head.text(name)
            head.uint32(offset)
            head.byte(_UINT32 if name == "t" else _FLOAT32)
            head.uint32(1)
        head.byte(False)  # the highest byte first
        head.uint32(POINT.itemsize)
        size = POINT.itemsize * len(self.points)
        head.uint32(size)  # of a row
        head.uint32(size)  # of all rows
        return b"".join((head.finish(), self.points.tobytes(), b"\x01"))


def pointcloud2(scan: Scan, *, frame_id: str = "laser", mount_yaw: float = 0.0) -> PointCloud2:
    """The returns of a scan as points, in the order of measuring.

    Args:
        scan: The scan.
        frame_id: Name of the coordinate frame.
        mount_yaw: Angle of the device's forward axis in the frame, radians counter-clockwise.

    Raises:
        InvalidValue: `scan` is no `Scan`, `frame_id` no text, or `mount_yaw` not finite.
    """
    if not isinstance(scan, Scan):
        raise InvalidValue(f"pointcloud2() takes a Scan, not {shown(scan)}")
    frame_id, mount_yaw = text_of(frame_id, "frame_id"), finite(mount_yaw, "mount_yaw")
    # Of a sorted scan too; where angles tell the times, a corrected one may come before its neighbour.
    hit = np.flatnonzero(scan.valid)
    hit = hit[np.argsort(scan.times_ns[hit], kind="stable")]
    times_ns = scan.times_ns[hit]
    first_ns = int(times_ns[0]) if len(times_ns) else scan.stamp_ns
    # Single precision has no digits left behind many turns.
    angles, ranges = scan.angles[hit] + np.float32(math.remainder(mount_yaw, math.tau)), scan.ranges[hit]
    points = np.zeros(len(ranges), POINT)
    points["x"] = ranges * np.cos(angles)
    points["y"] = ranges * np.sin(angles)
    if scan.intensities is not None:
        points["intensity"] = scan.intensities[hit]
    points["t"] = np.clip(times_ns - first_ns, 0, _LONGEST_NS)
    return PointCloud2(scan.wall_stamp_ns + first_ns - scan.stamp_ns, frame_id, points)
