"""Where the lidar is on its robot, and what time it is: what nodes need beside the scans.

slam_toolbox, nav2 and RViz take no scan of a frame of which they do not know where it is. A robot with a
description says so by robot_state_publisher; any other one by a static transform, which `Publisher` sends itself. A
recording that is published with the stamps of its day needs nodes whose clock runs by it (``use_sim_time``).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Final

from lidario.arguments import finite, shown
from lidario.cdr import CdrWriter, stamp_bytes
from lidario.errors import InvalidValue

_SEVEN: Final = struct.Struct("<7d")


def mount_of(mount: object) -> tuple[float, float, float]:
    """Where the lidar is on its robot: metres forward, metres to the left, radians counter-clockwise.

    Raises:
        InvalidValue: It is not three numbers.
    """
    if not isinstance(mount, Sequence) or isinstance(mount, str) or len(mount) != 3:
        raise InvalidValue(f"a mount is x, y and yaw: metres and radians, not {shown(mount)}")
    x, y, yaw = (finite(value, "a mount's x, y and yaw") for value in mount)
    return x, y, yaw


def static_transform(stamp_ns: int, parent: str, child: str, mount: tuple[float, float, float]) -> bytes:
    """``tf2_msgs/TFMessage`` with one transform, as CDR: where the frame of the lidar is in that of the robot."""
    x, y, yaw = mount
    writer = CdrWriter()
    writer.uint32(1)
    writer.header(stamp_ns, parent)
    writer.text(child)
    writer.align(8)
    writer.raw(_SEVEN.pack(x, y, 0.0, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    return writer.finish()


def clock_message(stamp_ns: int) -> bytes:
    """``rosgraph_msgs/Clock``, as CDR."""
    writer = CdrWriter()
    writer.raw(stamp_bytes(stamp_ns))
    return writer.finish()
