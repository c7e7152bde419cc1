"""What turns the rotor, and what the host can do about it: four ways, as the profiles name them.

* ``rpm``: MOTOR_SPEED_CTRL sets the speed, clamped to what the device can do; SCAN starts a motor that is off
  (S-series interface manual).
* ``pwm``: an accessory board drives the motor by a duty, SET_MOTOR_PWM. Nothing else starts it: users' A2 and A3
  send no packet before. The speed follows from the duty by no formula that a host could know; here it is
  proportional. The board forgets the duty when the device restarts.
* ``dtr``: the USB board of an A1 switches the motor by the control line DTR; asserted stops it (SDK 2.1.0,
  `net_serial.cpp`).
* ``fixed``: it always turns.
"""

from __future__ import annotations

from lidario.families.rplidar.simulated.profile import Profile
from lidario.sim.motor import Motor

_DUTY = 660  # at which the motor has its own speed; the usual duty (pyrplidar)
_MOST_DUTY = 1023
_LIMITS = (480, 1200)  # rpm of devices that do not tell theirs


class Drive:
    """Turns one device's motor."""

    def __init__(self, profile: Profile, motor: Motor) -> None:
        self._profile = profile
        self._motor = motor
        if profile.motor in ("dtr", "fixed"):
            motor.spin_at_once(profile.own_rpm, 0)

    def scan_begins(self, now: int) -> None:
        """Start a motor that is off, where a scan does that."""
        if self._profile.motor == "rpm" and not self._motor.target_rpm:
            self._motor.set_rpm(self._profile.own_rpm, now)

    def set_speed(self, rpm: int, now: int) -> None:
        """MOTOR_SPEED_CTRL: 0 for off."""
        if rpm:
            least, greatest = self._profile.speed_conf[1:] or _LIMITS
            rpm = min(max(rpm, least), greatest)
        self._motor.set_rpm(rpm, now)

    def set_duty(self, duty: int, now: int) -> None:
        """SET_MOTOR_PWM: 0 for off."""
        self._motor.set_rpm(self._profile.own_rpm * min(duty, _MOST_DUTY) / _DUTY, now)

    def set_line(self, asserted: bool, now: int) -> None:
        """Set DTR."""
        self._motor.set_rpm(0.0 if asserted else self._profile.own_rpm, now)

    def protect(self, now: int) -> None:
        """What Protection Stop and a restart do to the motor."""
        if self._profile.motor in ("rpm", "pwm"):
            self._motor.set_rpm(0, now)
