"""The motor of an RPLIDAR: four ways to turn it. The way is decided once, after the device has said what it is.

=====  =========================================  ====================================================
way    who                                        what the host does
=====  =========================================  ====================================================
RPM    S and T series; a C1 that tells its limits MOTOR_SPEED_CTRL, revolutions a minute
PWM    A2, A3 with an accessory board             SET_MOTOR_PWM, a duty. They send no packet before
DTR    A1                                         the control line: cleared turns it, asserted stops it
NONE   A2, A3 on a bare UART; other C1            nothing, except the request that would stop the motor
=====  =========================================  ====================================================

Vendor's SDK 2.1.0, `checkMotorCtrlSupport` and `setMotorSpeed`, with two differences. The SDK assumes that a C1 has
no motor request; here it is asked for its limits, since a user's C1 obeyed MOTOR_SPEED_CTRL. And the SDK moves DTR
whenever it knows no other way. Users report that an A2 or A3 hears nothing while DTR is asserted, so for these DTR
stays cleared, as it is when the port was opened.

A C1 that does not respond is started as one without limits, and asked again when its speed is wanted. A device that
does not tell its typical speed or duty is started with an assumed one, and asked again at the next start.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

from lidario.basics.arguments import finite
from lidario.errors import InvalidValue, ResponseTimeout, Unsupported
from lidario.families.base import Device, Script
from lidario.families.rplidar import commands
from lidario.families.rplidar.commands import Conf
from lidario.families.rplidar.configuration import MOST_IN_VAIN, SHORT_S, Configuration
from lidario.wire.envelope import Request

FIRST_BY_SPEED: Final = 6
FIRST_C: Final = 4
A1: Final = 1


class Way(NamedTuple):
    """How the motor is turned."""

    why: str  # why its speed cannot be set; empty if it can
    request: Callable[[int], Request] | None = None  # makes the request for a speed or duty; None if there is none
    usual: int = 0  # speed or duty that other drivers send. Conf 0x01 tells a better one if the firmware has it.
    most: int = 0  # the highest speed or duty
    told_at: int = 0  # offset of the speed or duty in conf 0x01


RPM: Final = Way("", commands.motor_speed, 600, 0xFFFF)
PWM: Final = Way(
    "the motor of this model is driven by a duty (PWM), and nothing tells which duty makes which speed: "
    "its scan frequency cannot be set. Scan.rpm tells what it is",
    commands.motor_pwm,
    660,
    1023,
    told_at=2,
)
DTR: Final = Way(
    "the motor of this model can only be switched on and off (by DTR): its scan frequency cannot be set. "
    "Scan.rpm tells what it is"
)
NONE: Final = Way("this model has no motor control that the host could use. Scan.rpm tells how fast it turns")
UNTOLD: Final = Way(
    "this device did not tell between which speeds its motor turns: it takes none, or its responses were lost, "
    "and then it helps to try again. Scan.rpm tells how fast it turns"
)


class MotorDriven(Device):
    """The part of an RPLIDAR's scripts that controls its motor."""

    def __init__(self) -> None:
        self._configuration = Configuration()
        self._major = 0  # the upper four bits of its model number; 0 until the device has told it
        self._way: Way | None = None
        # The speed or the duty, and whether it is assumed because the device has not told it.
        self._speed: int | None = None
        self._is_assumed = False
        # The slowest and the fastest speed that the device takes; None until it has told them.
        self._told: tuple[int, int] | None = None

    def _be_of(self, major: int) -> None:
        """Take on the series that the device has told."""
        if major != self._major:
            self._major, self._speed, self._is_assumed = major, None, False
            self._way = RPM if major >= FIRST_BY_SPEED else DTR if major == A1 else None

    def _halt_motor(self) -> Request:
        """The request that stops the motor; if the way is not decided yet, one that does no harm."""
        if self._way is DTR:
            return commands.DTR_STOPS
        # Also if it seems to have no board or to take no speed, or is not identified yet: only the response may
        # have been lost, and a device that does not know the request ignores it.
        return commands.motor_pwm(0) if A1 < self._major < FIRST_C else commands.motor_speed(0)

    def _start_motor(self) -> Script[None]:
        way = yield from self._decided()
        if self._is_assumed:
            self._speed = None
        if way is DTR:
            yield commands.DTR_TURNS
        elif way.request is not None:
            yield way.request((yield from self._wanted(way)))

    def retune(self) -> Request | None:
        """As `Device.retune`.

        A stream goes on meanwhile. S-series interface manual, MOTOR_SPEED_CTRL: "real-time speed control", idle
        only at 0 rpm.
        """
        if self._way is not RPM or self._speed is None:
            return None
        return replace(commands.motor_speed(self._speed), in_stream=True)

    def explain_silence(self, lasted_s: float) -> Script[bool]:
        """As `Device.explain_silence`: an A2 or A3 is asked once more whether it has an accessory board.

        Its response may have been lost, and without a duty it sends no packet.
        """
        if lasted_s or self._way is not NONE or self._major >= FIRST_C:
            return False
        self._way = yield from self._board()
        return self._way is PWM

    def scan_frequency(self) -> Script[float]:
        """As `Device.scan_frequency`: the frequency that was set, else the device's own."""
        yield from self._check_speed()
        return (yield from self._wanted(RPM)) / 60

    def set_scan_frequency(self, hertz: float) -> Script[float]:
        """As `Device.set_scan_frequency`, for the next start or `retune`: a rotor that rests is not started."""
        yield from self._check_speed()
        wanted = finite(hertz, "a scan frequency")
        lowest, highest = yield from self._limits()
        rpm = round(min(max(wanted * 60, 0), 0x10000))  # the product may be infinite, and both ends are refused
        if not lowest <= rpm <= highest:
            raise InvalidValue(
                f"{wanted:g} Hz ({wanted * 60:g} rpm) is outside of this device's {lowest / 60:g} to "
                f"{highest / 60:g} Hz ({lowest} to {highest} rpm)"
            )
        self._speed, self._is_assumed = rpm, False
        return rpm / 60

    def scan_frequency_range(self) -> Script[tuple[float, float]]:
        """As `Device.scan_frequency_range`; if the device tells no limits, those of the request."""
        yield from self._check_speed()
        lowest, highest = yield from self._limits()
        return lowest / 60, highest / 60

    def _check_speed(self) -> Script[None]:
        if self._way is UNTOLD:
            self._way = None  # a start does not ask again, but a request for the speed does
        way = yield from self._decided()
        if way.why:
            raise Unsupported(way.why)

    def _decided(self) -> Script[Way]:
        if self._way is None:
            if self._major == 0:
                return RPM
            self._way = yield from (self._limited() if self._major >= FIRST_C else self._board())
        return self._way

    def _limited(self) -> Script[Way]:
        """The way of a C1: it takes a speed if it tells both limits. A silent one may not know the question."""
        for kind in (Conf.MIN_ROTATION, Conf.MAX_ROTATION):
            try:
                # A short timeout: a C1 that does not know the question is silent, and a stream must not wait long.
                told = yield replace(commands.get_lidar_conf(kind), timeout=SHORT_S)
            except ResponseTimeout:
                return UNTOLD
            if len(told) < 6:
                return NONE
        return RPM

    def _board(self) -> Script[Way]:
        try:
            flags = yield commands.GET_ACC_BOARD_FLAG
        except ResponseTimeout:
            return NONE
        return PWM if flags[0] & 1 else NONE

    def _wanted(self, way: Way) -> Script[int]:
        """The speed or the duty that was set, else the one that the device tells, else the usual one."""
        if self._speed is None:
            told = yield from self._word(Conf.DESIRED_ROTATION, way.told_at, MOST_IN_VAIN)
            if told and way is RPM:
                # Ask for the limits now, so that a speed that is set in mid-scan can be checked without
                # interrupting the stream. A device that does not know the first question does not know these
                # either.
                yield from self._limits()
            # Another script may have set the speed meanwhile: a script begins before its turn to ask comes.
            if self._speed is None:
                self._speed = told if told and told <= way.most else way.usual
                self._is_assumed = told is None
        return self._speed

    def _limits(self) -> Script[tuple[int, int]]:
        if self._told:
            return self._told
        lowest = yield from self._word(Conf.MIN_ROTATION, 0)
        highest = yield from self._word(Conf.MAX_ROTATION, 0)
        if lowest and highest:
            self._told = lowest, highest
        return lowest or 1, highest or 0xFFFF

    def _word(self, kind: Conf, at: int, most_in_vain: float = math.inf) -> Script[int | None]:
        """Two bytes of a configuration value; 0 if the device does not have it, None if it does not tell it."""
        value = yield from self._configuration.value(kind, most_in_vain)
        if value is None:
            return None
        return int.from_bytes(value[at : at + 2], "little") if len(value) >= at + 2 else 0
