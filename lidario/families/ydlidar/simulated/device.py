"""The device side: responds to requests and sends point clouds as a 4ROS does, and as strictly.

It discards what a real device discards (4ROS development manual where not said otherwise):

* while it scans it obeys nothing but STOP, FORCED_STOP (vendor SDK) and SCAN (manual 4); the last one only renews
  power-down protection, without a header (manual 3.8);
* with protection on, it stops when 3 s pass without a SCAN; protection is a state of the device, not of the
  connection: the next program finds it as the last one left it;
* the scan header comes at once, the first packet when the motor is up to speed;
* a request within 5 ms of a stop is discarded, the pause the vendor's SDK keeps; another stop is obeyed;
* after RESET it obeys nothing until it has booted. Then it is set as it came from the factory: 7 Hz (data sheet),
  protection off; and some models send device information that was not requested (`Profile.announces`);
* it responds to one of the two health requests, and not to the other;
* an unknown request is discarded silently, as are A5 D0 and D1, which only the SDK knows;
* reporting health 2, it starts no scan; RESET clears it if the fault has gone.

A scan starts the motor, a stop stops it. Steps of the speed end at 5 and 12 Hz (data sheet). Where all
documents are silent, the choice is ours: how long a restart takes and what it forgets, LSN, the spin-up time.

A request that arrives before the response to the one before has left is obeyed, since no document says that it is
discarded; but settings, device information and offset share one response type, so the host cannot tell whose
response comes. The log carries a remark on such a request.
"""

import struct
from typing import Unpack

from lidario.families.ydlidar.simulated.packers import SCAN_HEADER, pack_response
from lidario.families.ydlidar.simulated.profiles import PROFILES, Profile
from lidario.families.ydlidar.simulated.stream import PointStream
from lidario.sim.chassis import PROTECTION_STOP, Chassis, Maker, Making, maker
from lidario.sim.motor import Motor

__all__ = ["PROFILES", "Profile", "Simulated4Ros", "make_simulated"]

_MS = 1_000_000
_SETTLE_AFTER_STOP = 5 * _MS  # vendor SDK 1.2.20
_AFTER_STOP = "within 5 ms of stop"
_ALIVE_FOR = 3000 * _MS  # manual 3.8
_MOST_OUTSTANDING = 1000 * _MS
"""Time in which all responses that wait must leave; a client that asks without end would fill the memory."""
_SETTING, _HEALTH = 0x04, 0x06  # response types
_HARDWARE = 2

_NAMES = {
    0x00: "forced_stop",
    0x09: "speed_up_fine",
    0x0A: "speed_down_fine",
    0x0B: "speed_up",
    0x0C: "speed_down",
    0x0D: "get_speed",
    0x60: "scan",
    0x65: "stop",
    0x80: "reset",
    0x90: "get_info",
    0x91: "get_health",
    0x92: "get_health",
    0x93: "get_zero_offset",
    0xD9: "toggle_protection",
}
_OBEYED_WHILE_SCANNING = {0x00, 0x60, 0x65}
_STOPS = {0x00, 0x65}
_STEPS = {0x09: 10, 0x0A: -10, 0x0B: 100, 0x0C: -100}  # hundredths of Hz


class Simulated4Ros(Chassis[Profile, PointStream]):
    """One simulated device; obeys `lidario.sim.device.SimulatedDevice`. Arguments and more as for `Chassis`.

    A serial number is 16 bytes of 0 to 9, or 8 bytes of two digits each; else ValueError is raised.
    """

    def __init__(self, profile: Profile, **making: Unpack[Making]) -> None:
        super().__init__(profile, **making)
        serial, drawn = making.get("serial"), bytes(self._random.integers(0, 10, 16).tolist())
        self.serial: bytes = _digits(drawn if serial is None else serial)
        # Quarter degrees, of an R2 whose firmware is above 1.7 hundredths (ydlidar_4ros.md 4). It is only told.
        self.zero_offset: int = 0
        self.set_speed: int = profile.factory_speed  # hundredths of Hz
        self.protected: bool = False  # by power-down protection
        self.lapses: int = 0  # how often that has ended a scan
        self.response_delay_s: float = 0.0005
        self.motor: Motor = Motor(spin_up_s=profile.spin_up_s, turns=float(self._random.random()))
        self.lit: bool = True  # DTR, where it matters; lines that have none leave it asserted
        self._begun = False  # the first byte of a request is there
        self.alive_until: int = 0  # when protection ends the scan, unless the host is heard before

    def set_dtr(self, asserted: bool, now: int) -> None:
        """The host sets the control line DTR: some models are dark while it is cleared, others do not have it."""
        self._advance(now)
        if not self.profile.by_dtr or asserted is self.lit:
            return
        self.lit = asserted
        if not asserted:
            self.halt(now)
            self._begun = False
        self._talk(now, at_once=False)

    def _hear(self, data: bytes, now: int) -> None:
        """Take bytes that the host sent and that arrived at `now`; a model that only talks does not see them."""
        if self.profile.one_way or not self.lit:
            return
        for byte in data:
            if not self._begun:
                self._begun = byte == 0xA5
            elif byte != 0xA5:
                self._begun = False
                self._consider(byte, now)

    def wakeup(self, now: int) -> int | None:
        self._talk(now)
        return super().wakeup(now)

    def _due(self, stream: PointStream) -> int:
        return stream.ready

    def _advance(self, now: int) -> None:
        """Do what is due by `now`: build packets, stop when the keepalive is missing."""
        self._now = now = max(self._now, now)
        self._talk(now)
        if self._stream is not None and self.protected and now >= self.alive_until:
            self._build(self.alive_until)
            self.halt(self.alive_until)
            self.lapses += 1
        self._build(now)

    def _build(self, now: int) -> None:
        if self._stream is not None:
            for data, ready, size, period in self._stream.until(now):
                self._queue.push(data, ready, size=size, period=period)

    def _talk(self, now: int, *, at_once: bool = True) -> None:
        """A model that only talks streams as soon as it has power, and unless it failed."""
        is_dark = not self.lit or self.health[0] or now < self._deaf_until
        if not self.profile.one_way or is_dark or self._stream is not None:
            return
        past = 0
        if at_once and not self._deaf_until:
            # It has been on for long: the first byte that is heard stands anywhere in a revolution.
            self.motor.spin_at_once(self.set_speed * 0.6, now)
            past = int(self._random.integers(1, 400)) * self.profile.sample_ns
        else:
            self.motor.set_rpm(self.set_speed * 0.6, now)
        self._measure_from(max(now, self.motor.stable_at or 0) - past)

    def _measure_from(self, origin: int) -> None:
        self._stream = PointStream(origin, self.motor, self.world, self.profile)

    def _consider(self, command: int, now: int) -> None:
        """Obey a request or discard it, and remember which."""
        why, remark = self._refusal(command, now), ""
        if not why:
            remark = self._outstanding(now)
            self.obey(command, now)
        self.log.add(now, _NAMES.get(command, "unknown"), bytes((0xA5, command)), why, remark=remark)

    def _refusal(self, command: int, now: int) -> str:
        """Why the device discards a request; empty when it obeys."""
        if now < self._deaf_until and (command not in _STOPS or self._deaf_why != _AFTER_STOP):
            return self._deaf_why
        if command != self.profile.health_command and command not in self.profile.commands:
            return "unknown to this device"
        if self.scanning and command not in _OBEYED_WHILE_SCANNING:
            return "scanning"
        if command == 0x60 and self.health[0] == PROTECTION_STOP:
            return "in protection stop"
        if self._outstanding_until - now > _MOST_OUTSTANDING:
            return "too many responses are outstanding"
        return ""

    def obey(self, command: int, now: int) -> None:
        """Do what a request asks, and respond where it has a response."""
        if command in _STOPS:
            self.halt(now)
            self._deaf_until, self._deaf_why = now + _SETTLE_AFTER_STOP, _AFTER_STOP
        elif command == 0x80:
            self._reset(now)
        elif command == 0x60:
            self._scan(now)
        else:
            self._respond(self._garbled(pack_response(*self._reply(command))), now, _NAMES[command])

    def _reply(self, command: int) -> tuple[int, bytes]:
        """Response type and payload."""
        if command == 0x90:
            return _SETTING, self.info()
        if command == self.profile.health_command:
            return _HEALTH, struct.pack("<BH", *self.health)
        if command == 0x93:
            return _SETTING, struct.pack("<i", self.zero_offset)
        if command == 0xD9:
            self.protected = not self.protected
            return _SETTING, bytes((not self.protected,))
        lowest, highest = self.profile.speeds
        self.set_speed = min(max(self.set_speed + _STEPS.get(command, 0), lowest), highest)
        return _SETTING, struct.pack("<I", self.set_speed)

    def info(self) -> bytes:
        """What it tells of itself."""
        major, minor = self.profile.firmware
        return bytes((self.profile.model, minor, major, _HARDWARE)) + self.serial

    def _scan(self, now: int) -> None:
        """Announce a stream that begins once the motor is up to speed, or keep alive the one there is."""
        self.alive_until = now + _ALIVE_FOR
        if self._stream is not None:
            return
        self.motor.set_rpm(self.set_speed * 0.6, now)
        announced = self._respond(SCAN_HEADER, now, "scan")
        early = self.profile.early_hertz
        turning = self.motor.reaches(60 * early) if early else self.motor.stable_at
        self._measure_from(max(announced, turning or 0))

    def _restart(self, now: int, up: int) -> None:
        super()._restart(now, up)
        self._begun = False
        self.set_speed, self.protected = self.profile.factory_speed, False
        if self.profile.announces:
            self._queue.push(pack_response(_SETTING, self.info()), up)


make_simulated: Maker[Simulated4Ros] = maker(Simulated4Ros, PROFILES)


def _digits(serial: bytes) -> bytes:
    """Sixteen bytes of 0 to 9."""
    digits = bytes(int(digit, 16) for digit in serial.hex()) if len(serial) == 8 else serial
    if len(digits) != 16 or max(digits) > 9:
        raise ValueError(f"a serial number of a 4ROS has 16 digits, which {serial.hex()} has not")
    return digits
