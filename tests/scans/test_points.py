"""Points of scans on a robot: mounted, moving, merged; each against the plain formula, a point at a time."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lidario.errors import InvalidValue
from lidario.scans.points import Motion, Mount, Velocity, merge
from lidario.scans.scan import Scan
from tests.scans.test_scan import FOUR, scan

NEAR = st.floats(-3, 3)


def driven(velocity: Velocity, seconds: float, steps: int = 20_000) -> tuple[float, float, float]:
    """Where a robot is after this time, by many small steps along its own axes (midpoint rule)."""
    x = y = yaw = 0.0
    each = seconds / steps
    for _ in range(steps):
        middle = yaw + velocity.yaw * each / 2
        x += (velocity.x * math.cos(middle) - velocity.y * math.sin(middle)) * each
        y += (velocity.x * math.sin(middle) + velocity.y * math.cos(middle)) * each
        yaw += velocity.yaw * each
    return x, y, yaw


def expected(made: Scan, mount: Mount, pose: tuple[float, float, float], index: int) -> tuple[float, float]:
    """One sample in the frame that `pose` is given in."""
    distance, angle = float(made.ranges[index]), float(made.angles[index])
    x = mount.x + distance * math.cos(angle + mount.yaw)
    y = mount.y + distance * math.sin(angle + mount.yaw)
    return (
        pose[0] + x * math.cos(pose[2]) - y * math.sin(pose[2]),
        pose[1] + x * math.sin(pose[2]) + y * math.cos(pose[2]),
    )


@pytest.mark.parametrize("made", [Mount, Velocity])
@pytest.mark.parametrize("name", ["x", "y", "yaw"])
def test_a_place_is_of_numbers_that_can_be_meant(made: type[Mount | Velocity], name: str) -> None:
    assert isinstance(getattr(made(**{name: 1}), name), float)
    for wrong in ("1", math.nan, 1e7):
        with pytest.raises(InvalidValue, match=f"{name} of a {made.__name__}"):
            made(**{name: wrong})  # type: ignore[arg-type]


def test_degrees_are_no_yaw_of_a_mount() -> None:
    """A quarter of a turn is meant, and 90 radians are 14.3 turns."""
    with pytest.raises(InvalidValue, match=r"in radians, .* write math.radians\(90\)"):
        Mount(yaw=90)
    assert Velocity(yaw=20).yaw == 20


@given(NEAR, NEAR, st.floats(-7, 7))
def test_a_mounted_lidar(x: float, y: float, yaw: float) -> None:
    mount = Mount(x, y, yaw)
    points = FOUR.points(mount)
    for row, index in enumerate((0, 1, 3)):
        assert points.xy[row] == pytest.approx(expected(FOUR, mount, (0, 0, 0), index), abs=1e-5)


@pytest.mark.parametrize(
    "velocity", [Velocity(*each) for each in ((), (1.5,), (0, -0.7), (0, 0, 2.0), (1.0, 0.5, -3.0), (1, 0, 1e-9))]
)
@pytest.mark.parametrize("before_ms", [0, 40, 150])
def test_a_moving_robot(velocity: Velocity, before_ms: int) -> None:
    made = scan([0, -90, -180, 90], [1, 2, 3, 4], time_increment_ns=25_000_000, lost_packets=0, stamp_ns=10**12)
    mount = Mount(0.2, -0.1, 0.3)
    at_ns = made.stamp_ns + before_ms * 1_000_000
    points = made.points(mount, motion=velocity, at_ns=at_ns)
    for index in range(4):
        seconds = (index * 25_000_000 + made.stamp_ns - at_ns) * 1e-9
        pose = driven(velocity, seconds)
        assert points.xy[index] == pytest.approx(expected(made, mount, pose, index), abs=1e-4)
    assert points.times_ns.tolist() == [10**12 + index * 25_000_000 for index in range(4)]


def test_the_end_of_the_revolution_is_the_instant_when_none_is_given() -> None:
    made = scan([0, -90, -180, 90], [1, 2, 3, 4], time_increment_ns=25_000_000, lost_packets=0)
    end = made.stamp_ns + made.duration_ns
    velocity = Velocity(x=1.0)
    np.testing.assert_array_equal(made.points(motion=velocity).xy, made.points(motion=velocity, at_ns=end).xy)
    # What was measured 100 ms before the end is now 10 cm nearer.
    assert made.points(motion=velocity).xy[0] == pytest.approx((0.9, 0.0), abs=1e-6)


def test_poses_in_a_fixed_frame_and_a_velocity_agree() -> None:
    velocity = Velocity(0.8, 0.0, 1.2)
    made = scan([0, -90, -180, 90], [1, 2, 3, 4], time_increment_ns=25_000_000, lost_packets=0)

    def poses(times_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        # The frame is anywhere: 5 m away and turned.
        found = []
        for time_ns in times_ns.tolist():
            x, y, yaw = driven(velocity, (time_ns - made.stamp_ns) * 1e-9, steps=2000)
            found.append((5 + x * math.cos(2) - y * math.sin(2), -3 + x * math.sin(2) + y * math.cos(2), yaw + 2))
        return np.array(found)

    by_pose, by_velocity = made.points(motion=poses), made.points(motion=velocity)
    np.testing.assert_allclose(by_pose.xy, by_velocity.xy, atol=1e-4)


@pytest.mark.parametrize("shape", [(4,), (2, 5), (4, 2)])
def test_a_pose_function_that_returns_something_else(shape: tuple[int, ...]) -> None:
    wrong: Motion = lambda times_ns: np.zeros(shape)  # noqa: E731 - the mistake a user makes
    with pytest.raises(InvalidValue, match=r"shape \(4, 3\)"):
        FOUR.points(motion=wrong)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e39])
def test_a_pose_that_is_nowhere_is_refused(value: float) -> None:
    """Points that are NaN are not near, and a robot would not stop for them."""
    with pytest.raises(InvalidValue, match="must return finite poses"):
        FOUR.points(motion=lambda times_ns: np.full((len(times_ns), 3), value), at_ns=0)


def test_merged() -> None:
    one, two = FOUR.points(), FOUR.points(Mount(x=10))
    both = merge(one, two)
    assert len(both) == 6
    np.testing.assert_array_equal(both.xy, np.concatenate((one.xy, two.xy)))
    np.testing.assert_array_equal(both.times_ns, np.concatenate((one.times_ns, two.times_ns)))
    assert both.source.tolist() == [0, 0, 0, 1, 1, 1]
    assert both.intensities is not None
    assert both.intensities.tolist() == [10, 20, 40] * 2


def test_merged_with_one_that_sends_no_intensities() -> None:
    assert merge(FOUR.points(), scan([0], [1]).points()).intensities is None


def test_merged_of_none_and_of_too_many() -> None:
    assert len(merge()) == 0
    assert merge().xy.shape == (0, 2)
    empty = scan([], []).points()
    assert len(merge(*[empty] * 256)) == 0
    with pytest.raises(InvalidValue, match="at most 256"):
        merge(*[empty] * 257)
