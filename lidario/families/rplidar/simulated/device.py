"""The device side: responds to requests and sends measurement streams as a real one does, and as strictly.

It discards what a real device discards:

* a request within 10 ms of a STOP or 500 ms of a RESET is discarded, and after a RESET there is no response
  until booting is over (S-series interface manual, STOP and RESET; S1 needs 2 s in the field). In idle a STOP is
  ignored (the same manual): a request right behind it is obeyed, with a remark;
* a request whose last byte arrives before the response to the one before has left completely is discarded, STOP
  included (the same manual: one request at a time); for a scan the descriptor is the response;
* a request that is damaged, incomplete after 5 s, or unknown is discarded silently, and so is a GET_LIDAR_CONF of
  a type that the firmware does not know (vendor SDK 2.1.0: any response to type 0x79 means Ethernet);
* any request that is understood ends the stream under way, a query included; MOTOR_SPEED_CTRL does with 0 alone
  (the same manual: "idle only if Rpm = 0"), and with a speed the head changes to that while the stream goes on;
* in Protection Stop (health 2) STOP and all scans are discarded (the same manual); RESET clears it if the fault has
  gone;
* samples are withheld until the motor is up to speed, except after FORCE_SCAN;
* an EXPRESS_SCAN of a mode the device lacks gets no response;
* where the motor is driven by an accessory board or by DTR, a scan does not start it: the descriptor comes, and no
  packet before the motor turns.

What turns the rotor (`Profile.motor`): MOTOR_SPEED_CTRL clamps a speed to what the device can do (the same manual).
The speed follows from the duty of SET_MOTOR_PWM by no formula that a host could know; here it is proportional. The
accessory board forgets it when the device restarts. DTR asserted stops an A1 (SDK 2.1.0, `net_serial.cpp`).

STOP leaves the motor running. Section numbers are not given: the manual's editions number them differently.
"""

from collections.abc import Callable
from typing import ClassVar, Unpack

from lidario.families.rplidar.simulated.identity import Identity, pack_announcement, pack_response
from lidario.families.rplidar.simulated.profile import Mode, Profile
from lidario.families.rplidar.simulated.profiles import PROFILES
from lidario.families.rplidar.simulated.requests import (
    IGNORED_IN_PROTECTION_STOP,
    PAYLOADS,
    LineSpeed,
    Request,
    RequestReader,
)
from lidario.families.rplidar.simulated.stream import MeasurementStream
from lidario.sim.chassis import PROTECTION_STOP, Chassis, Maker, Making, maker
from lidario.sim.motor import Motor

__all__ = ["PROFILES", "Mode", "Profile", "SimulatedRplidar", "make_simulated"]

_MS = 1_000_000
SETTLE_AFTER_STOP = 10 * _MS  # for how long nothing is heard behind STOP (S-series interface manual, STOP)
_AFTER_IGNORED = "within 10 ms of a stop that was ignored"
_SETTLE_AFTER_RESET = 500 * _MS  # S-series interface manual, RESET
_DUTY = 660  # at which the motor has its own speed; the usual duty (pyrplidar)
_MOST_DUTY = 1023
_LIMITS = (480, 1200)  # rpm of devices that do not tell theirs


class SimulatedRplidar(Chassis[Profile, MeasurementStream]):
    """One simulated device; obeys `lidario.sim.device.SimulatedDevice`. Arguments and more as for `Chassis`.

    A test may put another one in the place of `identity`, which responds to questions, of `set_speed`, `line_speed`
    and `HANDLERS`, which obey the other requests. A serial number has 16 bytes; else ValueError is raised.
    """

    def __init__(self, profile: Profile, **making: Unpack[Making]) -> None:
        super().__init__(profile, **making)
        serial = making.get("serial")
        self.serial: bytes = self._random.bytes(16) if serial is None else bytes(serial)
        self.identity: Identity = Identity(self.serial)
        self.response_delay_s: float = 0.0015
        self.boot_s: float = profile.boot_s
        self.motor: Motor = Motor(turns=float(self._random.random()))
        if profile.motor in ("dtr", "fixed"):
            self.motor.spin_at_once(profile.own_rpm, 0)
        self._reader = RequestReader()
        self.line_speed: LineSpeed = LineSpeed(profile.baudrate)
        self._ignored_until = 0
        self._waiting: Mode | None = None  # a stream that was announced, while the motor is off

    @property
    def is_network(self) -> bool:
        """Whether it is reached by UDP."""
        return self.profile.is_network

    @property
    def scanning(self) -> bool:
        """Whether a measurement stream runs, or waits for the motor."""
        return self._stream is not None or self._waiting is not None

    def set_dtr(self, asserted: bool, now: int) -> None:
        """The host sets the control line DTR: on an A1 the motor's switch, on others nothing.

        A stream pauses while the motor is off.
        """
        self._advance(now)
        if self.profile.motor != "dtr" or asserted is not self.motor_on:
            return
        mode = self._waiting if self._stream is None else self._stream.mode
        self._end_stream(now)
        self.motor.set_rpm(0.0 if asserted else self.profile.own_rpm, now)
        if mode is not None:
            self._begin(mode, now)

    def _hear(self, data: bytes, now: int) -> None:
        """Take bytes that the host sent and that arrived at `now`."""
        if self.profile.measures_speed and self._stream is None and now >= self._deaf_until:
            self._queue.push(self.line_speed.hear(data, now), self._response_at(now))
            self._queue.baudrate = self.line_speed.now
        if self.line_speed.is_garbled:
            return
        for byte in data:
            request = self._reader.feed(byte, now)
            if request is not None:
                self._consider(request)

    def transmit(self, now: int) -> bytes:
        """As `Chassis.transmit`; at another speed than the device's, a host receives garbage."""
        data = super().transmit(now)
        return self._random.bytes(len(data)) if self.line_speed.is_garbled else data

    def set_host_baudrate(self, baudrate: int, now: int) -> None:
        """The host sets the speed of its port; one that is never told of runs at the device's speed."""
        self._advance(now)
        self.line_speed.host = baudrate

    @property
    def baudrate(self) -> int:
        """Speed of the device's end of the line in bits a second."""
        return self.line_speed.now

    def reboot(self, now: int, *, off_s: float = 0.0) -> None:
        """As `Chassis.reboot`; the speed of the line is that of the model again."""
        super().reboot(now, off_s=off_s)
        self.line_speed.lose_power()

    def _due(self, stream: MeasurementStream) -> int:
        return stream.ready + self._queue.airtime(stream.size)

    def _stop_motor(self, now: int) -> None:
        if self.profile.motor in ("rpm", "pwm"):
            self.motor.set_rpm(0, now)

    def _advance(self, now: int) -> None:
        """Do what is due by `now`: build packets, give up an incomplete request."""
        self._now = max(self._now, now)
        stream = self._stream
        if stream is not None:
            for data, made in stream.until(now):
                self._queue.push(data, made, size=stream.size, period=stream.period)
        self.line_speed.advance(now)
        self._queue.baudrate = self.line_speed.now
        late = self._reader.overdue(now)
        if late is not None:
            self.log.add(late.ended, late.name, late.data, late.fault)

    def _consider(self, request: Request) -> None:
        """Obey a request or discard it, and remember which."""
        why = self._refusal(request)
        remark = _AFTER_IGNORED if not why and request.began < self._ignored_until else ""
        if not why and request.name == "stop" and not self.scanning:
            self._ignored_until = request.ended + SETTLE_AFTER_STOP
        elif not why:
            if request.name != "motor_speed_ctrl" or not any(request.payload):
                self._end_stream(request.ended)
            why = self.HANDLERS.get(request.name, SimulatedRplidar._tell)(self, request)
        self.log.add(request.ended, request.name, request.data, why, remark=remark)

    def _refusal(self, request: Request) -> str:
        """Why the device discards a request at once; empty when it handles it."""
        if request.began < self._deaf_until:
            return self._deaf_why
        why = self._outstanding(request.ended) or request.fault
        if why:
            return why
        if request.name == "unknown" or request.name in self.profile.unknown:
            return "unknown to this device"
        if request.name == "new_baudrate_confirm" and not request.payload:
            return "unknown to this device"  # the question of another family, completed
        if self.health[0] == PROTECTION_STOP and request.name in IGNORED_IN_PROTECTION_STOP:
            return "in protection stop"
        if request.name == "get_lidar_conf" and not self.profile.has_conf:
            return "unknown to this firmware"
        given, wanted = len(request.payload), PAYLOADS[request.name]
        if given < wanted or (given > wanted and request.name != "get_lidar_conf"):
            return f"payload of {given} bytes"
        if request.name == "get_lidar_conf" and self.identity.conf(self.profile, request.payload) is None:
            return "unknown to this firmware"
        return ""

    def _stop(self, request: Request) -> str:
        self._deaf_until, self._deaf_why = request.ended + SETTLE_AFTER_STOP, "within 10 ms of stop"
        return ""

    def _obey_reset(self, request: Request) -> str:
        self._reset(request.ended)
        settled = request.ended + _SETTLE_AFTER_RESET
        if self._deaf_until <= settled:
            self._deaf_until, self._deaf_why = settled, "within 500 ms of reset"
        return ""

    def _restart(self, now: int, up: int) -> None:
        super()._restart(now, up)
        self._reader.clear()
        self.identity.restart()
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

    def _hq_scan(self, request: Request) -> str:
        mode = next(each for each in self.profile.modes if each.response_type == 0x83)
        return self._start(mode, request)

    def _start(self, mode: Mode, request: Request, *, force: bool = False) -> str:
        """Announce a stream and begin it once the motor is up to speed."""
        now = request.ended
        if self.profile.motor == "rpm" and not self.motor_on:
            self.motor.set_rpm(self.profile.own_rpm, now)
        announced = self._respond(pack_announcement(mode), now, request.name)
        self._begin(mode, announced, force=force)
        return ""

    def _begin(self, mode: Mode, now: int, *, force: bool = False) -> None:
        """Measure from now on, or from when the motor is up to speed."""
        stable = self.motor.stable_at
        if stable is None:
            self._waiting = mode
            return
        origin = now if force else max(now, stable)
        self._stream = MeasurementStream(
            mode, origin, self.motor, self.world, triangulates=self.profile.triangulates
        )

    def _end_stream(self, now: int) -> None:
        self._waiting = None
        super()._end_stream(now)

    def _motor_speed_ctrl(self, request: Request) -> str:
        # What was built already was measured at the speed before.
        since = request.ended if self._stream is None else max(request.ended, self._stream.built_until)
        self.set_speed(int.from_bytes(request.payload, "little"), since)
        return ""

    def set_speed(self, rpm: int, now: int) -> None:
        """MOTOR_SPEED_CTRL: 0 for off."""
        if rpm:
            least, greatest = self.profile.speed_conf[1:] or _LIMITS
            rpm = min(max(rpm, least), greatest)
        self.motor.set_rpm(rpm, now)

    def _set_motor_pwm(self, request: Request) -> str:
        duty = min(int.from_bytes(request.payload, "little"), _MOST_DUTY)
        self.motor.set_rpm(self.profile.own_rpm * duty / _DUTY, request.ended)
        return ""

    def _tell(self, request: Request) -> str:
        """Respond to a question, or to a setting of what the device tells."""
        told = self.identity.respond(request, self.profile, self.health)
        return "unknown to this firmware" if told is None else self.respond(*told, request)

    def respond(self, kind: int, data: bytes, request: Request) -> str:
        """Send a single response, or noise of the same length when it is to be garbled."""
        response = self._garbled(pack_response(kind, data))
        self._respond(response, request.ended, request.name)
        return ""

    HANDLERS: ClassVar[dict[str, Callable[["SimulatedRplidar", Request], str]]] = {
        "stop": _stop,
        "reset": _obey_reset,
        "scan": _scan,
        "force_scan": _force_scan,
        "express_scan": _express_scan,
        "motor_speed_ctrl": _motor_speed_ctrl,
        "hq_scan": _hq_scan,
        "set_motor_pwm": _set_motor_pwm,
        "new_baudrate_confirm": lambda device, request: device.line_speed.confirm(request.payload),
    }


make_simulated: Maker[SimulatedRplidar] = maker(SimulatedRplidar, PROFILES)
