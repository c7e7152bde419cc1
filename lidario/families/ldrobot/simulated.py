"""The device side: streams from power-up on, even if no program listens.

All models but one have no line on which a request could arrive: what the host writes is not even seen. The LD14P
obeys four requests (`_NAMES`), discards what has a wrong check value, and sends the response that the vendor's SDK
skips. It streams from power-up too, until it is stopped.

A sample is taken at ``origin + n * sample time`` (rates as in `PROFILES`: LD06 as measured on a real device, the
others by data sheet), where the motor points then. Twelve of them make a packet, which may lie across 0. Time
stamps count milliseconds and begin anew at 30000 (`Profile.wrap_ms`: an LD08 may do so at 65536). Models that
triangulate state the angle of the beam; what they measure lies beside it, by the formula of the vendor's SDK.

Layout: LD06 development manual v1.0; records and responses: the vendor's SDKs. Nothing is shared with the host's
side; tests use `pack_points` as the inverse of the decoder.

No document says how long a device boots, or what it does when its rotor is blocked: it boots in half a second
(users report 0.5 to 0.7 s), and a blocked one is silent until its power is cut.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lidario.sim.chassis import Maker, by_name, maker
from lidario.sim.talker import Floats, PacedByTime, TalkerProfile, within

_MARK, _REQUEST_BYTES = 0x54, 8
_NAMES = {0xA0: "start", 0xA1: "stop", 0xA2: "set_speed", 0xA8: "get_version"}
_SPEEDS = (720, 2880)  # degrees a second: the vendor's SDK

_POLYNOMIAL = 0x4D
_POINT = np.dtype([("mm", "<u2"), ("intensity", "u1")])
_PACKET = np.dtype(
    [
        ("mark", "u1", 2), ("speed", "<u2"), ("first", "<u2"), ("points", _POINT, 12), ("last", "<u2"),
        ("time", "<u2"), ("check", "u1"),
    ]
)  # fmt: skip
_Lens = Callable[[Floats], tuple[Floats, Floats]]


def _near(mm: Floats) -> tuple[Floats, Floats]:
    """LD14 and LD14P: the distance is stated as it is."""
    away = np.degrees(np.arctan2(0.11923 * mm - 18.975571, mm + 5.9))
    return mm, np.where(mm > 0, away, 0.0)


def _axis(mm: Floats) -> tuple[Floats, Floats]:
    """LD08: the distance d is stated of which (d + 5.9)^2 + (0.11923 d - 20.14)^2 is the square of the true one."""
    a, b = 1 + 0.11923**2, 5.9 - 0.11923 * 20.14
    d = (np.sqrt(np.maximum(b * b - a * (5.9**2 + 20.14**2 - mm * mm), 0.0)) - b) / a
    seen = (mm > 0) & (d > 0)
    return np.where(seen, d, 0.0), np.where(seen, np.degrees(np.arctan2(0.11923 * d - 20.14, d + 5.9)), 0.0)


@dataclass(frozen=True, slots=True)
class Profile(TalkerProfile):
    """What kind of device it is."""

    # What a model that triangulates states, by the true distance: its own, and how far the target lies before the
    # beam, in degrees. None where it states the truth.
    lens: _Lens | None = None
    wrap_ms: int = 30_000  # where its time stamps begin anew


_LD06 = Profile(
    "ldrobot-ld06", 1, baudrate=230_400, hertz=10.0, rate=4546.0, samples=12, reach_mm=(20.0, 12_000.0),
    follows="andyblarblar/LD06", uneven=0.031,
)  # fmt: skip
_LD19 = replace(_LD06, name="ldrobot-ld19", model=2, rate=4500.0, follows="", uneven=0.0)
_LD14 = Profile("ldrobot-ld14", 7, hertz=6.0, rate=2300.0, samples=12, lens=_near)
PROFILES = by_name(
    _LD06,
    _LD19,
    replace(_LD19, name="ldrobot-stl06p", model=3, rate=5000.0),
    replace(_LD19, name="ldrobot-stl19p", model=4),
    replace(_LD19, name="ldrobot-stl26", model=5, rate=5000.0),
    replace(_LD19, name="ldrobot-stl27l", model=6, baudrate=921_600, rate=21_600.0, reach_mm=(30.0, 25_000.0)),
    replace(_LD14, name="ldrobot-ld08", model=9, hertz=5.0, reach_mm=(120.0, 8000.0), lens=_axis),
    _LD14,
    replace(_LD14, name="ldrobot-ld14p", model=8, baudrate=230_400, rate=4000.0, commands=True),
)


class SimulatedLdrobot(PacedByTime[Profile]):
    """One simulated device; arguments and attributes as in `Talker`."""

    _begun = b""

    def _hear(self, data: bytes, now: int) -> None:
        """Take bytes that the host sent; only a model with a line for requests sees them."""
        if not self.profile.commands:
            return
        for byte in data:
            self._begun = (self._begun + bytes((byte,)))[-_REQUEST_BYTES:]
            if len(self._begun) == _REQUEST_BYTES and self._begun[0] == _MARK and self._begun[1] in _NAMES:
                request, self._begun = self._begun, b""
                self._consider(request, now)

    def _pack(self, turns: Floats, seconds: Floats, rpm: float) -> bytes:
        beam, at, reach = turns.ravel() * 360.0, seconds.ravel(), self.profile.reach_mm
        mm = self._world.ranges_mm(beam, at)
        if self.profile.lens is None:
            mm = within(mm, reach)
        else:
            seen = within(self._world.ranges_mm(beam - self.profile.lens(mm)[1], at), reach)
            mm = self.profile.lens(seen)[0]
        strength = np.where(mm > 0, np.clip(240 - mm / 60, 40, 240), 0).astype(np.uint8)
        hundredths = np.floor(turns * 36_000).astype(np.int64) % 36_000
        return pack_points(
            mm.reshape(turns.shape),
            strength.reshape(turns.shape),
            hundredths[:, 0],
            hundredths[:, -1],
            speed=round(rpm * 6),
            milliseconds=(seconds[:, 0] * 1e3 % self.profile.wrap_ms).astype(np.int64),
        )

    def _consider(self, request: bytes, now: int) -> None:
        """Obey a request or discard it, and remember which."""
        row = np.frombuffer(request, np.uint8)[None]
        why = self._deaf_why if now < self._deaf_until else "wrong check value" if check_of(row)[0] else ""
        name = _NAMES[request[1]]
        if not why:
            self._obey(name, int.from_bytes(request[3:5], "little"), now)
            self._respond(pack_response(request[1]), now, name)
        self.log.add(now, name, request, why)

    def _obey(self, name: str, parameter: int, now: int) -> None:
        if name == "stop":
            self.halt(now)
        elif name == "start" and self._stream is None:
            self._start(now)
        elif name == "set_speed":
            self._rpm = min(max(parameter, _SPEEDS[0]), _SPEEDS[1]) / 6
            if self._stream is not None:
                self._end_stream(now)
                self._start(now)

    def _restart(self, now: int, up: int) -> None:
        self._begun = b""
        self._rpm = self.profile.hertz * 60
        super()._restart(now, up)


make_simulated: Maker[SimulatedLdrobot] = maker(SimulatedLdrobot, PROFILES)


def _of_bytes() -> npt.NDArray[np.uint8]:
    """The CRC of each byte, made for all of them bit by bit."""
    value = np.arange(256)
    for _ in range(8):
        value = np.where(value & 0x80, value << 1 ^ _POLYNOMIAL, value << 1) & 0xFF
    return value.astype(np.uint8)


_OF_BYTES = _of_bytes()


def check_of(data: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """CRC-8 of each row; shape (packets, bytes) to (packets,)."""
    value = np.zeros(len(data), np.uint8)
    for column in data.T:
        value = _OF_BYTES[value ^ column]
    return value


def pack_points(
    distances_mm: npt.ArrayLike,
    intensities: npt.ArrayLike,
    first: npt.ArrayLike,
    last: npt.ArrayLike,
    *,
    speed: npt.ArrayLike = 3600,
    milliseconds: npt.ArrayLike = 0,
) -> bytes:
    """Pack measurement packets, back to back: distances and intensities of the shape (12,) or (packets, 12).

    Angles are 1/100 degrees, the speed degrees a second. 0 mm is no return.
    """
    distances = np.atleast_2d(np.rint(np.asarray(distances_mm, np.float64)))
    packets = np.empty(len(distances), _PACKET)
    packets["mark"] = 0x54, 0x2C
    packets["points"]["mm"] = distances
    packets["points"]["intensity"] = np.asarray(intensities, np.uint8)
    packets["first"], packets["last"], packets["speed"], packets["time"] = first, last, speed, milliseconds
    packets["check"] = check_of(packets.view(np.uint8).reshape(len(packets), -1)[:, :-1])
    return packets.tobytes()


def pack_response(command: int, payload: bytes = bytes(4)) -> bytes:
    """What the LD14P sends after a request; the contents are documented nowhere."""
    body = struct.pack("<BBB", 0x54, command, len(payload)) + payload
    return body + bytes(check_of(np.frombuffer(body, np.uint8)[None]))
