"""What nodes of ROS 2 make of a LaserScan, one beam after the other; written from what their sources do.

- slam_toolbox (``laser_utils.cpp``, karto's ``LaserRangeFinder``) makes a model of the sensor of the first message
  of a frame. How many beams it expects follows from the angles of that message. A later message with another number
  of beams is refused, and one with the same number gets the angles of the first one, whatever it says itself.
- laser_geometry (``projectLaser_``) takes each message by itself.

A message is an object with the fields of ``sensor_msgs/LaserScan``, as ``rosbags`` makes it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
FULL_CIRCLE = math.radians(350)
MAX_LASER_RANGE = 25.0
"""Metres, unless its configuration says otherwise."""
FLOAT_EPSILON = float(np.finfo(np.float32).eps)


class SlamToolbox:
    """The sensor as slam_toolbox knows it, once the first message has come.

    Attributes:
        refused: Messages that it did not take.
    """

    def __init__(self) -> None:
        self.refused: int = 0
        self._expected: int | None = None

    def take(self, message: Any) -> Points | None:
        """The returns of a message as (n, 2), metres in the frame of the lidar; None where it refuses it."""
        if self._expected is None:
            self._learn(message)
        if len(message.ranges) != self._expected:
            self.refused += 1
            return None
        found = []
        for beam, distance in enumerate(message.ranges.tolist()):
            if self._nearest <= distance <= self._farthest:
                angle = self._begin + beam * self._step
                found.append((distance * math.cos(angle), distance * math.sin(angle)))
        return np.array(found).reshape(-1, 2)

    def _learn(self, message: Any) -> None:
        self._begin, end, self._step = message.angle_min, message.angle_max, message.angle_increment
        self._nearest = message.range_min
        self._farthest = min(MAX_LASER_RANGE, message.range_max)
        width = abs(end - self._begin)
        beams_between_ends = round(width / self._step) + 1
        is_round = abs(width - 2 * math.pi) < self._step - FLOAT_EPSILON * 2 * math.pi
        if width > FULL_CIRCLE and beams_between_ends == len(message.ranges):
            is_round = False
        self._expected = round((end - self._begin) / self._step) + (0 if is_round else 1)


def laser_geometry(message: Any) -> Points:
    """The returns of a message as (n, 2), metres in the frame of the lidar."""
    found = []
    for beam, distance in enumerate(message.ranges.tolist()):
        # The comparisons leave out NaN.
        if message.range_min <= distance < message.range_max:
            angle = message.angle_min + beam * message.angle_increment
            found.append((distance * math.cos(angle), distance * math.sin(angle)))
    return np.array(found).reshape(-1, 2)


def moved(points: Points, transform: Any) -> Points:
    """Points of a lidar in the frame of its robot, by a ``geometry_msgs/TransformStamped`` about the z axis."""
    place, turn = transform.transform.translation, transform.transform.rotation
    # The matrix of a quaternion, its upper left part.
    right = 2 * (turn.x * turn.y + turn.w * turn.z)
    matrix = np.array(
        [
            [1 - 2 * (turn.y**2 + turn.z**2), 2 * (turn.x * turn.y - turn.w * turn.z)],
            [right, 1 - 2 * (turn.x**2 + turn.z**2)],
        ]
    )
    shifted: Points = points @ matrix.T + (place.x, place.y)
    return shifted
