"""Points in the frame of a robot: where a lidar is mounted, when each point was measured, how the robot moved.

A revolution takes 70 to 150 ms. A robot that drives 1 m/s or turns 1 rad/s in this time sees the beginning of the
revolution from another place than its end. Every point has its time here, so it can be moved to where the robot
would have seen it at one common instant. Merging several lidars is then only to put their points into one array.

Two frames occur: that of the lidar (x forward, y left, metres) and that of the robot. `Mount` says where the lidar
is in the second.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import MODERATE, callable_of, moderate, shown
from lidario.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class _Planar:
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("x", self.x), ("y", self.y), ("yaw", self.yaw)):
            object.__setattr__(self, name, moderate(value, f"{name} of a {type(self).__name__}"))


class Mount(_Planar):
    """Where a lidar is on a robot.

    Attributes:
        x: Metres forward of the robot's origin.
        y: Metres to the left of it.
        yaw: Direction of the lidar's forward axis, radians counter-clockwise from the robot's.

    Raises:
        InvalidValue: One of them is no number, or more than 1e6 away from 0; or `yaw` is more than two turns, so
            that degrees are meant.
    """

    __slots__ = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.yaw) > 2 * math.tau:
            raise InvalidValue(
                f"yaw of a Mount is in radians, and {self.yaw:g} are more than two turns: for degrees write "
                f"math.radians({self.yaw:g})"
            )


class Velocity(_Planar):
    """How a robot moves, in its own frame: steadily during the revolution.

    Attributes:
        x: Metres a second forward.
        y: Metres a second to the left.
        yaw: Radians a second counter-clockwise.

    Raises:
        InvalidValue: One of them is no number, or more than 1e6 away from 0.
    """

    __slots__ = ()


PoseFunction = Callable[[NDArray[np.int64]], NDArray[np.floating]]
"""Times, int64 nanoseconds on the clock of `Scan.stamp_ns`, shape (n,), to poses of the robot in any frame that
does not move: shape (n, 3), metres, metres, radians counter-clockwise."""

Motion = Velocity | PoseFunction


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """The samples with a return, of one lidar or of several, in one frame.

    Attributes:
        xy: Metres, float32, shape (n, 2): x forward, y left.
        times_ns: When each was measured, on the clock of `Scan.stamp_ns`; int64, shape (n,).
        intensities: uint8, shape (n,); None where one of the lidars sends none.
        source: Which argument of `merge` each came from; uint8, shape (n,), zeros for a single scan.
    """

    xy: NDArray[np.float32]
    times_ns: NDArray[np.int64]
    intensities: NDArray[np.uint8] | None
    source: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.times_ns)


def place(
    xy: NDArray[np.floating], times_ns: NDArray[np.int64], mount: Mount, motion: Motion | None, at_ns: int
) -> NDArray[np.float32]:
    """Points of a lidar's frame in the robot's frame, as the robot would have seen them at `at_ns`; metres, (n, 2).

    Raises:
        InvalidValue: `mount` or `motion` is wrong, or the pose function did not return finite numbers of shape
            (n, 3).
    """
    if not isinstance(mount, Mount):
        raise InvalidValue(f"mount is a Mount, not {shown(mount)}")
    placed = in_frame(xy, mount)
    if motion is None:
        return placed.astype(np.float32)
    if isinstance(motion, Velocity):
        seconds = np.asarray((times_ns - at_ns) * 1e-9, np.float64)
        yaw: NDArray[np.float64] = motion.yaw * seconds
        # The robot drives along an arc. sinc keeps the formula right for a robot that does not turn.
        ahead = seconds * np.sinc(yaw / np.pi)
        sideways = seconds * np.sin(yaw / 2) * np.sinc(yaw / (2 * np.pi))
        driven = np.stack((motion.x * ahead - motion.y * sideways, motion.x * sideways + motion.y * ahead), axis=1)
        moved: NDArray[np.float64] = _turned(placed, yaw) + driven
        return moved.astype(np.float32)
    callable_of(motion, "motion that is no Velocity")
    poses = _poses(motion, np.append(times_ns, np.int64(at_ns)))
    fixed = _turned(placed, poses[:-1, 2]) + poses[:-1, :2]
    return _turned(fixed - poses[-1, :2], -poses[-1, 2]).astype(np.float32)


def in_frame(xy: NDArray[np.floating], mount: Mount) -> NDArray[np.float64]:
    """Points of the frame that is at `mount`, in the frame in which it is there; metres, shape (n, 2)."""
    placed: NDArray[np.float64] = _turned(xy.astype(np.float64), np.float64(mount.yaw))
    placed += np.array([mount.x, mount.y])
    return placed


def merge(*clouds: Points) -> Points:
    """The points of several lidars as one, each with its time.

    The clouds must be in the same frame: give each its `Mount`, and, where the robot moves, each the same `at_ns`::

        at_ns = max(front.stamp_ns + front.duration_ns, rear.stamp_ns + rear.duration_ns)
        both = lidario.merge(
            front.points(Mount(x=0.2), motion=Velocity(x=0.8), at_ns=at_ns),
            rear.points(Mount(x=-0.2, yaw=math.pi), motion=Velocity(x=0.8), at_ns=at_ns),
        )

    Args:
        clouds: At most 256, each as `Scan.points` gives it.

    Raises:
        InvalidValue: More than 256 clouds, or what is none.
    """
    if len(clouds) > 256:
        raise InvalidValue(f"at most 256 lidars can be merged at once, not {len(clouds)}")
    for cloud in clouds:
        if not isinstance(cloud, Points):
            raise InvalidValue(f"merge(front.points(), rear.points()) takes points, not {shown(cloud)}")
    strengths = [cloud.intensities for cloud in clouds if cloud.intensities is not None]
    # A cloud without a point has none to tell.
    all_told = all(cloud.intensities is not None or not len(cloud) for cloud in clouds)
    return Points(
        np.concatenate([np.zeros((0, 2), np.float32), *(cloud.xy for cloud in clouds)]),
        np.concatenate([np.zeros(0, np.int64), *(cloud.times_ns for cloud in clouds)]),
        np.concatenate(strengths) if strengths and all_told else None,
        np.repeat(np.arange(len(clouds), dtype=np.uint8), [len(cloud) for cloud in clouds]),
    )


def _turned(xy: NDArray[np.float64], yaw: NDArray[np.float64] | np.float64) -> NDArray[np.float64]:
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack((xy[:, 0] * cos - xy[:, 1] * sin, xy[:, 0] * sin + xy[:, 1] * cos), axis=1)


def _poses(pose: PoseFunction, times_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    returned = pose(times_ns)
    try:
        poses = np.asarray(returned, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValue(
            f"the pose function must return an array of numbers; it returned {shown(returned)}"
        ) from None
    if poses.shape != (len(times_ns), 3):
        raise InvalidValue(
            f"the pose function must return an array of shape ({len(times_ns)}, 3) for {len(times_ns)} times: x, y "
            f"in metres and yaw in radians; it returned shape {poses.shape}"
        )
    if not (np.abs(poses) < MODERATE**2).all():
        # Points that are nowhere are not near either, and a robot would not stop for them.
        raise InvalidValue(
            "the pose function must return finite poses; it returned some that are not, or far too large"
        )
    return poses
