"""The device side: responds to requests and sends measurement streams as a real one does, and as strictly.

It discards what a real device discards:

* a request within 10 ms of a STOP or 500 ms of a RESET is discarded, and after a RESET there is no response
  until booting is over (S-series interface manual, STOP and RESET; S1 needs 2 s in the field);
* a request whose last byte arrives before the response to the one before has left completely is discarded, STOP
  included (the same manual: one request at a time); for a scan the descriptor is the response;
* a request that is damaged, incomplete after 5 s, or unknown is discarded silently, and so is a GET_LIDAR_CONF of
  a type that the firmware does not know (vendor SDK 2.1.0: any response to type 0x79 means Ethernet);
* any request that is understood ends the stream under way, a query and MOTOR_SPEED_CTRL included;
* in Protection Stop (health 2) STOP and all scans are discarded (the same manual); RESET clears it if the fault has
  gone;
* samples are withheld until the motor is up to speed, except after FORCE_SCAN;
* an EXPRESS_SCAN of a mode the device lacks gets no response.

SCAN starts a motor that is off, STOP leaves it running, RESET switches it off. Speeds outside of what the
device can do are clamped. Section numbers are not given: the manual's editions number them differently.

`SimulatedRplidar.log` tells of every request, with the reason where it was discarded. To put the device
into a state that occurs in practice, use its documented attributes, `begin_streaming` and `protection_stop`; a
request that a killed program left unfinished is simply received: the bytes ``A5 82 05``, say.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import ClassVar

from lidario.families.rplidar.simulated.profiles import PROFILES, Mode, Profile
from lidario.families.rplidar.simulated.requests import Request, RequestReader
from lidario.families.rplidar.simulated.stream import MeasurementStream
from lidario.sim.chassis import PROTECTION_STOP, Chassis
from lidario.sim.motor import Motor
from lidario.sim.world import WorldLike

__all__ = ["PROFILES", "Mode", "Profile", "SimulatedRplidar", "make_simulated"]

_MS = 1_000_000
_SETTLE_AFTER_STOP = 10 * _MS  # S-series interface manual, STOP
_SETTLE_AFTER_RESET = 500 * _MS  # S-series interface manual, RESET
_DEFAULT_RPM = 600  # S-series interface manual, motor speed; vendor SDK 2.1.0 falls back to the same
_CONTINUOUS = 1 << 30  # send mode in the descriptor's length word

# Response types of single responses (S-series interface manual; 0x15 and 0x20 as in vendor SDK 2.1.0).
_INFO, _HEALTH, _SAMPLERATE, _CONF = 0x04, 0x06, 0x15, 0x20


class SimulatedRplidar(Chassis[MeasurementStream]):
    """One simulated device; obeys `lidario.sim.device.SimulatedDevice`.

    Args:
        profile: What it is.
        world: What it sees; the furnished room by default.
        serial: Its 16-byte serial number; drawn from `seed` by default.
        seed: Decides serial number, noise of the default world, first angle and garbled responses.

    Attributes:
        profile: What it is.
        serial: Its serial number.
        health: Status (0 good, 1 warning, 2 Protection Stop) and error code; this and more as in `Chassis`.

    Raises:
        ValueError: The serial number has not 16 bytes.
    """

    def __init__(
        self,
        profile: Profile,
        *,
        world: WorldLike | None = None,
        serial: bytes | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__(profile.baudrate, world, seed, profile.model)
        self.profile = profile
        self.serial: bytes = self._random.bytes(16) if serial is None else bytes(serial)
        if len(self.serial) != 16:
            raise ValueError(f"a serial number has 16 bytes, not {len(self.serial)}")
        self.response_delay_s: float = 0.0015
        self.boot_s: float = profile.boot_s
        self._motor = Motor(turns=float(self._random.random()))
        self._reader = RequestReader()
        if not profile.motor_command:
            self._motor.spin_up_s = 0.0
            self._motor.set_rpm(_DEFAULT_RPM, 0)

    def receive(self, data: bytes, now: int) -> None:
        """Take bytes that the host sent and that arrived at `now`."""
        self._advance(now)
        for byte in data:
            request = self._reader.feed(byte, now)
            if request is not None:
                self._consider(request)

    def wakeup(self, now: int) -> int | None:
        """When the next response or packet will have left; None while the device is idle."""
        at = self._queue.wakeup(now)
        stream = self._stream
        if at is None and stream is not None:
            at = max(now, stream.ready + self._queue.airtime(stream.size))
        return at

    def begin_streaming(self, mode_id: int, now: int) -> None:
        """Be in the middle of a scan, and of a packet, as after a program that was killed.

        Raises:
            ValueError: The device has no such mode.
        """
        mode = self.profile.mode(mode_id)
        if mode is None:
            raise ValueError(f"{self.profile.name} has no scan mode {mode_id}")
        past = 10 * mode.period_ns + self._queue.airtime(mode.packet[0] * 2 // 5)
        if not self.motor_on:
            self._spin_at_once(_DEFAULT_RPM, now - past)
        self._stream = MeasurementStream(mode, now - past, self._motor, self.world, first=False)
        self._advance(now)
        self._queue.take(now)

    def protection_stop(self, error_code: int) -> None:
        """Fail: the stream and the motor stop, and health reports the error until a RESET clears it."""
        self._fault(error_code)
        self._end_stream(self._now)
        if self.profile.motor_command:
            self._motor.set_rpm(0, self._now)

    def _advance(self, now: int) -> None:
        """Do what is due by `now`: build packets, give up an incomplete request."""
        self._now = max(self._now, now)
        stream = self._stream
        if stream is not None:
            for data, made in stream.until(now):
                self._queue.push(data, made, size=stream.size, period=stream.period)
        late = self._reader.overdue(now)
        if late is not None:
            self._log.add(late.ended, late.name, late.data, late.fault)

    def _consider(self, request: Request) -> None:
        """Obey a request or discard it, and remember which."""
        why = self._refusal(request)
        if not why:
            self._end_stream(request.ended)
            why = self._HANDLERS[request.name](self, request)
        self._log.add(request.ended, request.name, request.data, why)

    def _refusal(self, request: Request) -> str:
        """Why the device discards a request at once; empty when it handles it."""
        if request.began < self._deaf_until:
            return self._deaf_why
        outstanding = self._outstanding(request.ended)
        if outstanding:
            return outstanding
        if request.fault:
            return request.fault
        if request.name not in self._HANDLERS:
            return "unknown to this device"
        if self.health[0] == PROTECTION_STOP and request.name in _IGNORED_IN_PROTECTION_STOP:
            return "in protection stop"
        if request.name == "get_lidar_conf" and not self.profile.has_conf:
            return "unknown to this firmware"
        if request.name == "motor_speed_ctrl" and not self.profile.motor_command:
            return "unknown to this device"
        given, wanted = len(request.payload), _PAYLOADS.get(request.name, 0)
        if given < wanted or (given > wanted and request.name != "get_lidar_conf"):
            return f"payload of {given} bytes"
        if request.name == "get_lidar_conf" and self._conf(request) is None:
            return "unknown to this firmware"
        return ""

    def _stop(self, request: Request) -> str:
        self._deaf_until, self._deaf_why = request.ended + _SETTLE_AFTER_STOP, "within 10 ms of stop"
        return ""

    def _reset(self, request: Request) -> str:
        now = request.ended
        up = now + int(self.boot_s * 1e9)
        self._restart(now, up)
        settled = now + _SETTLE_AFTER_RESET
        if up <= settled:
            self._deaf_until, self._deaf_why = settled, "within 500 ms of reset"
        else:
            self._deaf_why = "still booting after reset"
        return ""

    def _restart(self, now: int, up: int) -> None:
        self._forget(now)
        self._reader.clear()
        if self.profile.motor_command:
            self._motor.set_rpm(0, now)
        self._recover()
        self._deaf_until, self._deaf_why = up, "still booting"
        self._queue.push(self.profile.banner, up)

    def _scan(self, request: Request) -> str:
        return self._start(self.profile.standard, request)

    def _force_scan(self, request: Request) -> str:
        return self._start(self.profile.standard, request, force=True)

    def _express_scan(self, request: Request) -> str:
        # S-series interface manual: working mode 0 is the legacy express scan, not the mode of that number.
        legacy = None if request.payload[0] else self.profile.legacy_express
        mode = legacy or self.profile.mode(request.payload[0])
        return f"no scan mode {request.payload[0]}" if mode is None else self._start(mode, request)

    def _start(self, mode: Mode, request: Request, *, force: bool = False) -> str:
        """Announce a stream and begin it once the motor is up to speed."""
        now = request.ended
        if not self.motor_on:
            self._motor.set_rpm(_DEFAULT_RPM, now)
        announced = self._response_at(now)
        self._respond_with(_descriptor(mode.packet[0] | _CONTINUOUS, mode.response_type), announced, request.name)
        stable = self._motor.stable_at
        origin = announced if force or stable is None else max(announced, stable)
        self._stream = MeasurementStream(mode, origin, self._motor, self.world)
        return ""

    def _motor_speed_ctrl(self, request: Request) -> str:
        rpm = int.from_bytes(request.payload, "little")
        if rpm:
            _, least, greatest = self.profile.speed_conf or _SPEED_LIMITS
            rpm = min(max(rpm, least), greatest)
        self._motor.set_rpm(rpm, request.ended)
        return ""

    def _get_info(self, request: Request) -> str:
        major, minor = self.profile.firmware
        head = bytes([self.profile.model, minor, major, self.profile.hardware])
        return self._respond(_INFO, head + self.serial, request)

    def _get_health(self, request: Request) -> str:
        return self._respond(_HEALTH, struct.pack("<BH", *self.health), request)

    def _get_samplerate(self, request: Request) -> str:
        others = [mode for mode in self.profile.modes if mode.response_type != 0x81]
        standard = self.profile.standard.said_us_q8
        express = others[-1].said_us_q8 if others else standard
        return self._respond(_SAMPLERATE, struct.pack("<HH", standard >> 8, express >> 8), request)

    def _get_lidar_conf(self, request: Request) -> str:
        return self._respond(_CONF, request.payload[:4] + (self._conf(request) or b""), request)

    def _conf(self, request: Request) -> bytes | None:
        """The value that GET_LIDAR_CONF asks for; None where the firmware does not know its type."""
        return self.profile.conf(int.from_bytes(request.payload[:4], "little"), request.payload[4:])

    def _respond(self, kind: int, data: bytes, request: Request) -> str:
        """Send a single response, or noise of the same length when it is to be garbled."""
        response = self._garbled(_descriptor(len(data), kind) + data)
        self._respond_with(response, self._response_at(request.ended), request.name)
        return ""

    _HANDLERS: ClassVar[dict[str, Callable[[SimulatedRplidar, Request], str]]] = {
        "stop": _stop,
        "reset": _reset,
        "scan": _scan,
        "force_scan": _force_scan,
        "express_scan": _express_scan,
        "get_info": _get_info,
        "get_health": _get_health,
        "get_samplerate": _get_samplerate,
        "get_lidar_conf": _get_lidar_conf,
        "motor_speed_ctrl": _motor_speed_ctrl,
    }


def make_simulated(
    model: str, *, world: WorldLike | None = None, serial: bytes | None = None, seed: int = 0
) -> SimulatedRplidar:
    """Build a simulated device by the name of its profile, such as ``"rplidar-s2"``.

    Raises:
        ValueError: No profile has that name.
    """
    if model not in PROFILES:
        raise ValueError(f"no simulated device is called {model!r}; there are {', '.join(PROFILES)}")
    return SimulatedRplidar(PROFILES[model], world=world, serial=serial, seed=seed)


def _descriptor(length: int, kind: int) -> bytes:
    """``A5 5A``, length of one packet with the send mode in the top bits, response type."""
    return struct.pack("<BBIB", 0xA5, 0x5A, length, kind)


# Bytes of payload; GET_LIDAR_CONF has at least these (S-series interface manual, request formats).
_PAYLOADS = {"express_scan": 5, "get_lidar_conf": 4, "motor_speed_ctrl": 2}
# S-series interface manual, states of the device; it names STOP and SCAN, and the other scans have the same states.
_IGNORED_IN_PROTECTION_STOP = {"stop", "scan", "force_scan", "express_scan"}
_SPEED_LIMITS = (_DEFAULT_RPM, 480, 1200)  # of devices that do not tell theirs
