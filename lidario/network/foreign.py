"""The scan that a message holds: one of ours, or a LaserScan of anybody's ROS 2 node."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from lidario.laserscan import LaserScan
from lidario.network.bus import Sample
from lidario.network.keys import LASERSCAN_IN_KEY
from lidario.network.messages import MOST_SAMPLES, parse_scan
from lidario.recording.chronicle import MOST_NS
from lidario.scan import Scan, read_only

_LONGEST_S: Final = 1e3
_MOST_RANGE_M: Final = 1e6
_WHOLE_DEG: Final = 350.0
"""A message that covers this much is taken for a whole revolution."""


def whole_scan(sample: Sample, wall_offset_ns: int, seq: int = 0) -> Scan | None:
    """The scan that a message holds, with the number `seq` where it tells none; None where it holds no scan."""
    if LASERSCAN_IN_KEY not in sample.key:
        return parse_scan(sample.payload, wall_offset_ns)
    laser = LaserScan.from_cdr(sample.payload)
    return None if laser is None else scan_of_laserscan(laser, seq, wall_offset_ns)


def scan_of_laserscan(laser: LaserScan, seq: int, wall_offset_ns: int) -> Scan | None:
    """The beams as samples, in the order in which the message says that they were measured.

    A beam without a valid range becomes a sample without a return. Intensities below 0 become 0, those above 255
    become 255. None where the figures cannot be those of a scan.
    """
    count = len(laser.ranges)
    if count > MOST_SAMPLES or abs(laser.stamp_ns) >= MOST_NS // 2:
        return None
    figures = (laser.angle_min, laser.angle_increment, laser.time_increment, laser.scan_time)
    if not all(map(math.isfinite, figures)):
        return None
    if abs(laser.angle_increment) * count > 4 * math.pi or abs(laser.angle_min) > 4 * math.pi:
        return None
    every_s = laser.time_increment
    if not every_s and 0 < laser.scan_time <= _LONGEST_S and count:
        # It says nothing of the time of a beam: the devices of most drivers turn clockwise.
        every_s = -math.copysign(laser.scan_time / count, laser.angle_increment)
    if abs(every_s) * max(count, 1) > _LONGEST_S:
        return None
    ranges, strengths = laser.ranges, laser.intensities if len(laser.intensities) == count else None
    angles = -np.degrees(laser.angle_min + laser.angle_increment * np.arange(count))
    wall_ns = laser.stamp_ns
    if every_s < 0:
        ranges, angles = ranges[::-1], angles[::-1]
        strengths = None if strengths is None else strengths[::-1]
        wall_ns += round((count - 1) * every_s * 1e9) if count else 0
    step_deg = -math.degrees(laser.angle_increment) * (-1.0 if every_s < 0 else 1.0)
    farthest = laser.range_max if 0 < laser.range_max < _MOST_RANGE_M else _MOST_RANGE_M
    valid = (ranges >= laser.range_min) & (ranges <= farthest) & (ranges > 0)
    turned = (angles % 360.0).astype(np.float32)
    # Just below 360 degrees, single precision rounds up to 360.
    turned[turned >= 360.0] = 0.0
    whole = abs(step_deg) * count >= _WHOLE_DEG
    duration_ns = round(abs(every_s) * count * 1e9)
    return Scan(
        device_angles=read_only(turned),
        device_distances=read_only(np.where(valid, ranges, np.float32(0)) * np.float32(1000)),
        intensities=None
        if strengths is None
        else read_only(np.nan_to_num(strengths).clip(0, 255).astype(np.uint8)),
        stamp_ns=wall_ns - wall_offset_ns,
        wall_stamp_ns=wall_ns,
        time_increment_ns=round(abs(every_s) * 1e9),
        duration_ns=duration_ns,
        rpm=60e9 / duration_ns if whole and duration_ns else math.nan,
        seq=seq,
        dropped_before=0,
        lost_packets=0,
        mode="LaserScan",
        max_range=farthest if farthest < _MOST_RANGE_M else 0.0,
        # The beams stand in the middle of their steps.
        seam=float((angles[0] - step_deg / 2) % 360.0) if count and step_deg > 0 and whole else 0.0,
    )
