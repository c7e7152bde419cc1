"""The world: directions, the nearest wall, the walker, and noise that is a function of angle and time."""

from __future__ import annotations

import numpy as np
import pytest

from lidario.sim.rooms import make_world
from lidario.sim.world import Walker, World, cast

TURN = np.arange(3200) * (360.0 / 3200)


def test_angles_are_clockwise_from_straight_ahead() -> None:
    # walls: 3 m ahead, 2 m to the right (y = -2), 4 m to the left, 5 m behind
    world = World(
        cast([(3, -1, 3, 1), (-1, -2, 1, -2), (-1, 4, 1, 4), (-5, -1, -5, 1)])
    )  # fmt: skip
    ranges = world.ranges_mm(np.array([0.0, 90.0, 180.0, 270.0, 45.0]), 0.0)
    np.testing.assert_allclose(ranges, [3000, 2000, 5000, 4000, 0], rtol=1e-6)


def test_an_oblique_wall_follows_the_cosine() -> None:
    world = World(cast([(3, -10, 3, 10)]))
    degrees = np.array([-60.0, -30.0, 10.0, 60.0])
    np.testing.assert_allclose(
        world.ranges_mm(degrees, 0.0), 3000.0 / np.cos(np.radians(degrees)), rtol=2e-3
    )  # fmt: skip


def test_the_nearest_wall_wins_in_any_order() -> None:
    near, far = (2.0, -1.0, 2.0, 1.0), (6.0, -9.0, 6.0, 9.0)
    for walls in ([near, far], [far, near]):
        ranges = World(cast(walls)).ranges_mm(np.array([0.0, 45.0]), 0.0)
        np.testing.assert_allclose(ranges, [2000.0, 6000.0 * 2**0.5], rtol=1e-3)


def test_the_walker_hides_what_is_behind() -> None:
    # A person of 0.25 m radius who stands (ellipse of no size) 2 m to the right, before a wall at 3 m.
    walker = Walker((0.0, -2.0), (0.0, 0.0))
    world = World(cast([(-9, -3, 9, -3)]), walker=walker)
    edge = np.degrees(np.arcsin(0.25 / 2.0))
    ranges = world.ranges_mm(np.array([90.0, 90.0 - edge - 0.1, 90.0 + edge + 0.1, 90.0 + edge - 0.1]), 1.0)
    assert ranges[0] == pytest.approx(1750.0)
    np.testing.assert_allclose(ranges[1:3], 3000.0 / np.cos(np.radians(edge + 0.1)), rtol=1e-3)
    assert ranges[3] < 2000.0


def test_a_wall_hides_the_walker() -> None:
    world = World(cast([(-9, -1, 9, -1)]), walker=Walker((0.0, -2.0), (0.0, 0.0)))
    assert world.ranges_mm(90.0, 0.0)[0] == pytest.approx(1000.0)


def test_the_walker_moves_and_comes_back() -> None:
    world = World(np.zeros(32768), walker=Walker((3.0, 0.0), (0.5, 1.0), period_s=10.0))
    for t in (0.0, 1.25, 2.5, 7.0, 12.5):
        # At first ahead, and after a quarter of the round to the left.
        x, y = 3.0 + 0.5 * np.cos(2 * np.pi * t / 10.0), np.sin(2 * np.pi * t / 10.0)
        towards = np.degrees(np.arctan2(-y, x))
        assert world.ranges_mm(towards, t)[0] == pytest.approx(1000.0 * np.hypot(x, y) - 250.0, abs=0.1)


def test_each_beam_has_its_own_time() -> None:
    walker = Walker((3.0, 0.0), (0.5, 1.0), period_s=10.0)
    world = World(np.zeros(32768), walker=walker)
    times = np.linspace(0.0, 9.0, 40)
    angles = np.linspace(-30.0, 30.0, 40)
    together = world.ranges_mm(angles, times)
    alone = [world.ranges_mm(a, t)[0] for a, t in zip(angles, times, strict=True)]
    np.testing.assert_array_equal(together, alone)
    assert 0 < np.count_nonzero(together) < 40


def test_the_walker_must_not_walk_over_the_scanner() -> None:
    with pytest.raises(ValueError, match="over the lidar: choose another pose"):
        Walker((1.0, 0.0), (1.0, 0.5))


def test_noise_is_gaussian_and_a_function_of_angle_and_time() -> None:
    world = World(np.full(32768, 2000.0), noise_mm=5.0, seed=3)
    times = 100_000.0 + np.arange(TURN.size) * 31.25e-6
    ranges = world.ranges_mm(TURN, times)
    assert np.mean(ranges) == pytest.approx(2000.0, abs=0.5)
    assert np.std(ranges) == pytest.approx(5.0, rel=0.08)
    neighbours = np.corrcoef(ranges[1:] - 2000.0, ranges[:-1] - 2000.0)[0, 1]
    assert abs(neighbours) < 0.08
    np.testing.assert_array_equal(ranges[500:600], world.ranges_mm(TURN[500:600], times[500:600]))
    assert np.any(ranges != world.ranges_mm(TURN, times + 0.1))
    other = World(np.full(32768, 2000.0), noise_mm=5.0, seed=4)
    assert np.any(ranges != other.ranges_mm(TURN, times))


def test_noise_makes_no_return_out_of_nothing_and_no_negative_range() -> None:
    assert not World(np.zeros(32768), noise_mm=5.0).ranges_mm(TURN, 1.0).any()
    assert World(np.full(32768, 1.0), noise_mm=5.0).ranges_mm(TURN, 1.0).min() >= 0.0


def test_the_room_is_furnished_and_its_door_is_open() -> None:
    ranges = make_world("room").ranges_mm(TURN, 3.0)
    lost = ranges == 0.0
    assert 0.01 < lost.mean() < 0.1
    assert ranges[~lost].min() > 500.0
    assert ranges.max() < 7000.0
    assert np.count_nonzero(np.abs(np.diff(ranges)) > 200.0) > 12  # edges: it is no plain box
    # The door is ahead to the right: from (4.6, -0.6) to (4.6, -1.7), its leaf swung outwards.
    through = np.flatnonzero(lost) * (360.0 / 3200)
    assert through.min() > 7.0
    assert through.max() < 21.0


def test_the_other_worlds() -> None:
    assert not make_world("empty").ranges_mm(TURN, 0.0).any()
    np.testing.assert_array_equal(make_world("circle").ranges_mm(TURN, np.linspace(0, 1, 3200)), 2000.0)
    corridor = make_world("corridor").ranges_mm(np.array([90.0, 270.0, 180.0]), 0.0)
    np.testing.assert_allclose(corridor[:2], [900.0, 1100.0], atol=30.0)
    assert corridor[2] == 0.0
