"""The simulated motor: its speed approaches the target, and its angle is the integral of its speed."""

from __future__ import annotations

import numpy as np
import pytest

from lidario.sim.motor import Motor

SECOND = 1_000_000_000


def test_spin_up_time_is_from_standstill_to_within_two_per_cent() -> None:
    motor = Motor(spin_up_s=1.5)
    motor.set_rpm(600, 0)
    assert motor.stable_at == pytest.approx(1.5 * SECOND)
    assert motor.rpm(motor.stable_at or 0) == pytest.approx(588)
    assert motor.rpm(60 * SECOND) == pytest.approx(600)


def test_a_speed_on_the_way_up_is_reached_before_the_motor_is_stable() -> None:
    motor = Motor(spin_up_s=1.0)
    motor.set_rpm(600, SECOND)
    at = motor.reaches(120)
    assert at is not None
    assert SECOND < at < (motor.stable_at or 0)
    assert motor.rpm(at) == pytest.approx(120)
    assert motor.reaches(600) is None
    motor.set_rpm(600, 30 * SECOND)
    assert motor.reaches(120) == 30 * SECOND
    motor.set_rpm(0, 60 * SECOND)
    assert motor.reaches(700) is None


def test_the_angle_is_the_integral_of_the_speed() -> None:
    motor = Motor(spin_up_s=0.8)
    motor.set_rpm(720, 0)
    motor.set_rpm(300, SECOND)  # while still spinning up
    times = np.arange(SECOND, 5 * SECOND, 1_000_000, dtype=np.float64)
    speed = np.array([motor.rpm(int(time)) for time in times]) / 60.0
    middle = (speed[1:] + speed[:-1]) / 2.0 * 1e-3
    np.testing.assert_allclose(np.diff(motor.turns(times)), middle, atol=1e-6)


def test_what_was_measured_right_before_a_change_was_measured_at_the_speed_before() -> None:
    """A packet in the making begins before the request that came meanwhile."""
    motor = Motor(spin_up_s=0.0)
    motor.set_rpm(600, 0)
    motor.set_rpm(900, SECOND)
    np.testing.assert_allclose(motor.turns(np.array([0.9e9, 0.999e9, 1e9, 1.1e9])), [9.0, 9.99, 10.0, 11.5])


def test_an_uneven_rotor_is_even_over_a_turn() -> None:
    motor = Motor(spin_up_s=0.5, uneven=0.05)
    motor.set_rpm(600, 0)
    motor.set_rpm(300, SECOND)
    times = np.arange(10 * SECOND, 12 * SECOND, 1_000_000, dtype=np.float64)
    turned = motor.turns(times)
    np.testing.assert_allclose(turned[200:] - turned[:-200], 1.0, atol=1e-6)
    speed = np.diff(turned) * 200
    assert speed.std() == pytest.approx(0.05, abs=0.01)
    assert 0.8 < speed.min() < 0.95 < 1.05 < speed.max() < 1.2
