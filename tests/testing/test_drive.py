"""A lidar that drives: what it sees against a scalar reference, and what it says of where it was."""

from __future__ import annotations

import math

import numpy as np
import pytest

import lidario
from lidario.testing import Drive, SimulatedLidar, room

WALLS = room(4.0, 6.0)


def slow(pose: tuple[float, float, float], clockwise_deg: float) -> float:
    """Metres from there to the nearest of the four walls of a room of 6 m by 4 m, one beam at a time."""
    x, y, yaw = pose
    toward = yaw - math.radians(clockwise_deg)
    cos, sin = math.cos(toward), math.sin(toward)
    ways = [((3.0 if cos > 0 else -3.0) - x) / cos if cos else math.inf]
    ways.append(((2.0 if sin > 0 else -2.0) - y) / sin if sin else math.inf)
    return min(ways)


def test_each_sample_is_seen_from_where_the_lidar_was_then() -> None:
    drive = Drive([(0, -1.0, 0.5, 0.0), (2, 1.0, -0.5, 1.0)], WALLS)
    angles, seconds = np.linspace(0.0, 700.0, 97), np.linspace(5.0, 8.0, 97)
    seen = drive.ranges_mm(angles, seconds)
    for angle, second, found in zip(angles, seconds, seen, strict=True):
        share = min(1.0, (second - 5.0) / 2)
        pose = (-1.0 + 2 * share, 0.5 - share, share)
        assert found == pytest.approx(1000 * slow(pose, angle), abs=0.01)
        assert drive.poses([second * 1e9])[0] == pytest.approx(pose)


def test_where_there_is_no_wall_nothing_comes_back_and_noise_is_repeatable() -> None:
    assert not Drive([(0, 0, 0, 0)], [((1, 1), (2, 1))]).ranges_mm(np.array([90.0, 0.0]), np.zeros(2)).any()
    noisy = [
        Drive([(0, 0, 0, 0)], WALLS, noise=0.01, seed=3).ranges_mm(np.zeros(500), np.arange(500.0)) for _ in "ab"
    ]
    assert (noisy[0] == noisy[1]).all()
    assert 8 < noisy[0].std() < 12
    assert len(Drive([(0, 0, 0, 0)], WALLS).ranges_mm(np.zeros(0), np.zeros(0))) == 0


async def test_a_scan_on_the_way_is_bent_and_its_motion_makes_it_straight() -> None:
    drive = Drive([(0, 0.0, 0.0, 0.0), (60, 1.0, 0.0, 60.0)], WALLS)
    async with lidario.open_lidar(SimulatedLidar("rplidar-c1", world=drive)) as lidar:
        scan = await lidar.scan()
    placed = scan.points(motion=drive.poses, at_ns=scan.stamp_ns).xy
    x, y, yaw = drive.poses([scan.stamp_ns])[0]
    cos, sin = math.cos(yaw), math.sin(yaw)
    there = placed @ np.array([[cos, sin], [-sin, cos]]) + [x, y]
    off = np.minimum(abs(abs(there[:, 0]) - 3.0), abs(abs(there[:, 1]) - 2.0))
    # The bytes of a sample are some milliseconds on their way.
    assert off.max() < 0.02
    still = scan.points().xy @ np.array([[cos, sin], [-sin, cos]]) + [x, y]
    assert np.minimum(abs(abs(still[:, 0]) - 3.0), abs(abs(still[:, 1]) - 2.0)).max() > 0.05
