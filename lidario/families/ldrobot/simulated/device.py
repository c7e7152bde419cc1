"""The device side: streams from power-up on, even if no program listens.

All models but one have no line on which a request could arrive: what the host writes is not even seen. The LD14P
obeys four requests (`_NAMES`), discards what has a wrong check value, and sends the response that the vendor's SDK
skips. It streams from power-up too, until it is stopped.

A sample is taken at ``origin + n * sample time`` (rates as in `PROFILES`: LD06 as measured on a real device, the
others by data sheet), where the motor points then. Twelve of them make a packet, which may lie across 0. Time
stamps count milliseconds and begin anew at 30000. Models that triangulate state the angle of the beam; what they
measure lies beside it, by the formula of the vendor's SDK.

No document says how long a device boots, or what it does when its rotor is blocked: it boots in half a second
(users report 0.5 to 0.7 s), and a blocked one is silent until its power is cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lidario.families.ldrobot.simulated.packers import check_of, pack_points, pack_response
from lidario.sim.chassis import Chassis, Maker, maker
from lidario.sim.motor import Motor
from lidario.sim.world import WorldLike

__all__ = ["PROFILES", "Profile", "SimulatedLdrobot", "describe", "make_simulated"]

_POINTS = 12
_PACKET_BYTES = 47
_MARK, _REQUEST_BYTES = 0x54, 8
_NAMES = {0xA0: "start", 0xA1: "stop", 0xA2: "set_speed", 0xA8: "get_version"}
_SPEEDS = (720, 2880)  # degrees a second: the vendor's SDK
_AHEAD = 40  # packets that are built together
_BLOCKED = 1 << 62


_Floats = npt.NDArray[np.float64]
_Lens = Callable[[_Floats], tuple[_Floats, _Floats]]


def _near(mm: _Floats) -> tuple[_Floats, _Floats]:
    """LD14 and LD14P: the distance is stated as it is."""
    away = np.degrees(np.arctan2(0.11923 * mm - 18.975571, mm + 5.9))
    return mm, np.where(mm > 0, away, 0.0)


def _axis(mm: _Floats) -> tuple[_Floats, _Floats]:
    """LD08: the distance d is stated of which (d + 5.9)^2 + (0.11923 d - 20.14)^2 is the square of the true one."""
    a, b = 1 + 0.11923**2, 5.9 - 0.11923 * 20.14
    d = (np.sqrt(np.maximum(b * b - a * (5.9**2 + 20.14**2 - mm * mm), 0.0)) - b) / a
    seen = (mm > 0) & (d > 0)
    return np.where(seen, d, 0.0), np.where(seen, np.degrees(np.arctan2(0.11923 * d - 20.14, d + 5.9)), 0.0)


@dataclass(frozen=True, slots=True)
class Profile:
    """What kind of device it is.

    Attributes:
        name: Its name in ``sim://`` sources.
        model: Decides what is random.
        baudrate: Speed of its line.
        rate: Samples a second.
        hertz: Revolutions a second.
        reach_mm: Nearest and farthest distance.
        lens: What a model that triangulates states, by the true distance: its own, and how far the target lies
            before the beam, in degrees. None where it states the truth.
        commands: Whether it hears requests.
        follows: Which recording of a real device it follows, for people; empty where there is none.
    """

    name: str
    model: int
    baudrate: int = 230_400
    rate: float = 4500.0
    hertz: float = 10.0
    reach_mm: tuple[float, float] = (20.0, 12_000.0)
    lens: _Lens | None = None
    commands: bool = False
    follows: str = ""


PROFILES = {
    profile.name: profile
    for profile in (
        Profile("ldrobot-ld06", 1, rate=4546.0, follows="andyblarblar/LD06"),
        Profile("ldrobot-ld19", 2),
        Profile("ldrobot-stl06p", 3, rate=5000.0),
        Profile("ldrobot-stl19p", 4),
        Profile("ldrobot-stl26", 5, rate=5000.0),
        Profile("ldrobot-stl27l", 6, baudrate=921_600, rate=21_600.0, reach_mm=(30.0, 25_000.0)),
        Profile("ldrobot-ld08", 9, baudrate=115_200, rate=2300.0, hertz=5.0, reach_mm=(120.0, 8000.0), lens=_axis),
        Profile("ldrobot-ld14", 7, baudrate=115_200, rate=2300.0, hertz=6.0, reach_mm=(100.0, 8000.0), lens=_near),
        Profile("ldrobot-ld14p", 8, rate=4000.0, hertz=6.0, reach_mm=(100.0, 8000.0), lens=_near, commands=True),
    )
}


class _Stream:
    """Samples since the motor was up to speed."""

    def __init__(self, origin: int) -> None:
        self.origin = origin
        self.packets = 0


class SimulatedLdrobot(Chassis[_Stream]):
    """One simulated device; obeys `lidario.sim.device.SimulatedDevice`.

    Args:
        profile: What it is.
        world: What it sees; the furnished room by default.
        serial: Not used: it tells no serial number.
        seed: Decides noise, first angle and intensities.

    Attributes:
        profile: What it is; this and more as in `Chassis`.
    """

    def __init__(
        self,
        profile: Profile,
        *,
        world: WorldLike | None = None,
        serial: bytes | str | None = None,  # noqa: ARG002
        seed: int = 0,
    ) -> None:
        super().__init__(profile.baudrate, world, seed, profile.model)
        self.profile = profile
        self.boot_s: float = 0.5
        self._motor = Motor(spin_up_s=1.0, turns=float(self._random.random()))
        self._sample_ns = 1e9 / profile.rate
        self._up: int | None = None
        self._wanted = profile.hertz
        self._begun = b""

    def receive(self, data: bytes, now: int) -> None:
        """Take bytes that the host sent; only a model with a line for requests sees them."""
        self._advance(now)
        if not self.profile.commands:
            return
        for byte in data:
            self._begun = (self._begun + bytes((byte,)))[-_REQUEST_BYTES:]
            if len(self._begun) == _REQUEST_BYTES and self._begun[0] == _MARK and self._begun[1] in _NAMES:
                request, self._begun = self._begun, b""
                self._consider(request, now)

    def wakeup(self, now: int) -> int | None:
        """When the next packet will have left; None while it is stopped."""
        self._power(now)
        at = self._queue.wakeup(now)
        if at is not None:
            return at
        if self._stream is not None:
            return max(now, self._ready(self._stream))
        return self._up if self._up is not None and now < self._up < _BLOCKED else None

    def begin_streaming(self, now: int) -> None:
        """Be in the middle of a scan, and of a packet; so it is at any time anyway."""
        self._power(now)
        self._spin_at_once(self._wanted * 60, now)
        self._stream = _Stream(now - round(5.4 * _POINTS * self._sample_ns))
        self._advance(now)
        self._queue.take(now)

    def protection_stop(self, error_code: int) -> None:
        """Fail: the rotor is blocked, and nothing leaves until the power was cut."""
        self._fault(error_code)
        self._end_stream(self._now)
        self._motor.set_rpm(0.0, self._now)
        self._up = _BLOCKED

    def freeze(self, now: int) -> None:
        super().freeze(now)
        self._up = _BLOCKED

    def _power(self, now: int) -> None:
        """It has been on for long when it is first asked for anything."""
        if self._up is None:
            self._up = self._now = now
            self._spin_at_once(self._wanted * 60, now)
            # The first byte that is heard stands in the middle of a packet, wherever the seed says.
            self._stream = _Stream(now - int(self._random.integers(1, _POINTS) * self._sample_ns))

    def _advance(self, now: int) -> None:
        self._power(now)
        self._now = now = max(self._now, now)
        if (
            self._stream is None
            and self._motor.target_rpm <= 0
            and self._up
            and self._deaf_until <= self._up <= now
        ):
            self._start(self._up)
            self._up = _BLOCKED if self._stream is None else 0
        while self._stream is not None and self._ready(self._stream) <= now:
            self._build(self._stream)

    def _start(self, now: int) -> None:
        if self._stream is None:
            self._motor.set_rpm(self._wanted * 60, now)
            self._stream = _Stream(max(now, self._motor.stable_at or 0))

    def _ready(self, stream: _Stream) -> int:
        """When the first packet not built yet will have been measured."""
        return stream.origin + round((stream.packets + 1) * _POINTS * self._sample_ns)

    def _build(self, stream: _Stream) -> None:
        first = stream.packets * _POINTS
        times = np.arange(first, first + _AHEAD * _POINTS, dtype=np.float64) * self._sample_ns
        times += stream.origin
        turns = self._motor.turns(times)
        beam, seconds = turns * 360.0, times * 1e-9
        mm = self._world.ranges_mm(beam, seconds)
        if self.profile.lens:
            mm = self._world.ranges_mm(beam - self.profile.lens(mm)[1], seconds)
        mm[(mm < self.profile.reach_mm[0]) | (mm > self.profile.reach_mm[1])] = 0.0
        if self.profile.lens:
            mm = self.profile.lens(mm)[0]
        strength = np.where(mm > 0, np.clip(240 - mm / 60, 40, 240), 0).astype(np.uint8)
        hundredths = np.floor(turns * 36_000).astype(np.int64).reshape(-1, _POINTS) % 36_000
        data = pack_points(
            mm.reshape(-1, _POINTS),
            strength.reshape(-1, _POINTS),
            hundredths[:, 0],
            hundredths[:, -1],
            speed=round(self._motor.rpm(int(times[0])) * 6),
            milliseconds=(times[::_POINTS] // 1_000_000 % 30_000).astype(np.int64),
        )
        period = round(_POINTS * self._sample_ns)
        self._queue.push(data, self._ready(stream), size=_PACKET_BYTES, period=period)
        stream.packets += _AHEAD

    def _consider(self, request: bytes, now: int) -> None:
        """Obey a request or discard it, and remember which."""
        row = np.frombuffer(request, np.uint8)[None]
        why = self._deaf_why if now < self._deaf_until else "wrong check value" if check_of(row)[0] else ""
        name = _NAMES[request[1]]
        if not why:
            self._obey(name, int.from_bytes(request[3:5], "little"), now)
            self._queue.push(pack_response(request[1]), self._response_at(now))
        self._log.add(now, name, request, why)

    def _obey(self, name: str, parameter: int, now: int) -> None:
        if name == "stop":
            self._end_stream(now)
            self._motor.set_rpm(0.0, now)
            self._up = 0
        elif name == "start":
            self._start(now)
        elif name == "set_speed":
            self._wanted = min(max(parameter, _SPEEDS[0]), _SPEEDS[1]) / 360
            if self._stream is not None:
                self._end_stream(now)
                self._motor.set_rpm(self._wanted * 60, now)
                self._stream = _Stream(max(now, self._motor.stable_at or 0))

    def _restart(self, now: int, up: int) -> None:
        self._forget(now)
        self._begun = b""
        self._recover()
        self._motor.set_rpm(0.0, now)
        self._wanted = self.profile.hertz
        self._deaf_until, self._deaf_why, self._up = up, "still booting", up


make_simulated: Maker[SimulatedLdrobot] = maker(SimulatedLdrobot, PROFILES)
"""Builds a simulated device by the name of its profile, such as ``"ldrobot-ld06"``."""


def describe(model: str) -> str:
    """What a model is, in a few words."""
    profile = PROFILES[model]
    talks = "" if profile.commands else "; only talks"
    follows = f"; like {profile.follows}" if profile.follows else ""
    return f"{profile.baudrate} baud, {profile.rate:.0f}/s{talks}{follows}"
