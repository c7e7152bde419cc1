"""What simulated devices have in common that stream from power-up on: they boot, speed up, and talk for ever.

A family's device adds how packets are made. `PacedByAngle` is one that measures at angles, as turrets of robot
vacuums do: a packet has its place in the revolution, and when it is made follows from the speed of the rotor.
`PacedByTime` takes its samples at equal times, wherever the rotor stands.
"""

from abc import abstractmethod
from dataclasses import KW_ONLY, dataclass
from typing import Final, Generic, TypeVar, Unpack

import numpy as np
import numpy.typing as npt

from lidario.sim.chassis import FOREVER, Chassis, Making
from lidario.sim.motor import Motor

Floats = npt.NDArray[np.float64]

_LATEST_NS: Final = 5_000_000_000
"""A packet that is not made within this time never is: the rotor does not turn."""
_TOGETHER: Final = 12  # packets that are made together
_HALVINGS: Final = 18
"""Of twice that time, until so little is left that the rotor turns evenly in it."""


@dataclass(frozen=True, slots=True)
class TalkerProfile:
    """What kind of device it is; a family derives its own where there is more to tell."""

    name: str  # its name in ``sim://`` sources
    model: int  # decides what is random
    _: KW_ONLY
    baudrate: int = 115_200  # speed of its line
    hertz: float = 5.0  # revolutions a second
    rate: float = 1800.0  # samples a second
    slots: int = 0  # packets of a revolution, of one that measures at angles
    samples: int = 0  # samples of a packet, where it has as many at any speed
    reach_mm: tuple[float, float] = (100.0, 8000.0)  # nearest and farthest distance
    commands: bool = False  # whether it hears requests
    waits: bool = False  # whether it is silent until it is started
    early: bool = False  # whether it sends while its rotor speeds up, too
    back: bool = False  # whether it turns counter-clockwise
    uneven: float = 0.0  # as for `Motor`
    note: str = ""  # what else is to be told of it, for people
    follows: str = ""  # which recording of a real device it follows, for people; empty where there is none

    @property
    def about(self) -> str:
        """What it is, in a few words."""
        talks = "" if self.commands else "; only talks"
        follows = f"; like {self.follows}" if self.follows else ""
        return f"{self.baudrate} baud, {self.rate:.0f}/s{self.note}{talks}{follows}"


ProfileT = TypeVar("ProfileT", bound=TalkerProfile)


@dataclass(slots=True)
class Running:
    """A stream: what was sent since `origin`, when the first sample was taken.

    Of one that measures at angles, `packets` counts from where the rotor stood at 0. The first packet that was not
    made yet will be `ready` then.
    """

    origin: int
    packets: int
    ready: int


class Talker(Chassis[ProfileT, Running], Generic[ProfileT]):
    """One that talks from power-up on; what the host sends is not seen, unless a device derived from it does.

    Arguments and attributes as in `Chassis`. Such devices tell no serial number.
    """

    def __init__(self, profile: ProfileT, **making: Unpack[Making]) -> None:
        super().__init__(profile, **making)
        self.boot_s: float = 0.5
        self._rpm = profile.hertz * 60
        self.motor: Motor = Motor(spin_up_s=1.0, turns=float(self._random.random()), uneven=profile.uneven)
        self._up: int | None = None

    def _greeting(self) -> bytes:
        """What it says when it has booted."""
        return b""

    @abstractmethod
    def _make(self, stream: Running) -> None:
        """Make and queue the next packets of a stream, and tell when those behind them will be ready."""

    def wakeup(self, now: int) -> int | None:
        self._power(now)
        at = super().wakeup(now)
        if at is None and self._up is not None and now < self._up:
            at = self._up
        return at if at is not None and at < FOREVER else None

    def _due(self, stream: Running) -> int:
        return stream.ready

    def power_motor(self, rpm: float, now: int) -> None:
        """Turn the rotor at another speed, as who powers its motor may; 0 stops it."""
        self._advance(now)
        self._end_stream(now)
        self.motor.set_rpm(rpm, now)
        self._begin(now)

    def halt(self, now: int) -> None:
        """As `Chassis.halt`; nothing more, until it is started, or its power was cut."""
        super().halt(now)
        self._up = 0

    @abstractmethod
    def _begin(self, origin: int) -> None:
        """Begin a stream."""

    def _power(self, now: int) -> None:
        """It has been on for long when it is first heard."""
        if self._up is None:
            self._up = self._now = now
            if self.profile.waits:
                self._up = 0
                return
            self.motor.spin_at_once(self._rpm, now - 20_000_000)
            # The first byte that is heard stands in the middle of a packet, wherever the seed says.
            self._begin(now - int(self._random.integers(1, 20_000_000)))

    def _advance(self, now: int) -> None:
        self._power(now)
        self._now = now = max(self._now, now)
        up, stands = self._up, self._stream is None and self.motor.target_rpm <= 0
        if up and stands and self._deaf_until <= up <= now:
            self._start(up)
        while self._stream is not None and self._stream.ready <= now:
            self._make(self._stream)

    def _start(self, at: int) -> None:
        """It has booted, or was started: speed up, and stream from there on."""
        self._queue.push(self._greeting(), at)
        self.motor.set_rpm(self._rpm, at)
        self._begin(at if self.profile.early else max(at, self.motor.stable_at or 0))
        self._up = 0

    def _restart(self, now: int, up: int) -> None:
        super()._restart(now, up)
        self._up = 0 if self.profile.waits else up


class PacedByAngle(Talker[ProfileT]):
    """One whose packets have places in the revolution: equal slots of it."""

    def _samples(self, rpm: float) -> int:  # noqa: ARG002
        """Samples of a packet at that speed. Default: as many at any."""
        return self.profile.samples

    @abstractmethod
    def _pack(self, slot: int, seen: Floats, rpm: float) -> bytes:
        """The packet of a slot, by the millimetres that were seen in it; empty where it is not sent."""

    def _begin(self, origin: int) -> None:
        slots = self.profile.slots
        first = int(np.ceil(float(self.motor.turns(np.array([float(origin)]))[0]) * slots))
        self._stream = Running(origin, first, self._times(origin, np.array([(first + 1.0) / slots]))[0])

    def _times(self, begin: int, turns: Floats) -> list[int]:
        """When the rotor will have turned so far, or has; never, where it takes too long. `turns` ascend."""
        early, late = np.full(len(turns), float(begin - _LATEST_NS)), np.full(len(turns), float(begin + _LATEST_NS))
        for _ in range(_HALVINGS):
            middle = (early + late) / 2
            is_there = self.motor.turns(middle) >= turns
            early, late = np.where(is_there, early, middle), np.where(is_there, middle, late)
        before, behind = self.motor.turns(early), self.motor.turns(late)
        late -= (late - early) * (behind - turns) / np.maximum(behind - before, 1e-12)
        return [round(at) if at < begin + _LATEST_NS - 1 else FOREVER for at in late.tolist()]

    def _make(self, stream: Running) -> None:
        rpm = self.motor.rpm(stream.ready)
        samples = self._samples(rpm)
        numbers = stream.packets + np.arange(_TOGETHER)
        turned = (numbers[:, None] + np.arange(samples) / samples) / self.profile.slots
        # From where the first of these packets begins to where the one behind them ends.
        ends = (stream.packets + np.arange(_TOGETHER + 2.0)) / self.profile.slots
        _, *ready, following = times = self._times(stream.ready, ends)
        # Within a packet the rotor turns evenly.
        seconds = np.interp(turned.ravel(), ends, np.array(times, np.float64)) * 1e-9
        beams = turned.ravel() * (-360.0 if self.profile.back else 360.0) % 360.0
        seen = within(self._world.ranges_mm(beams, np.minimum(seconds, seconds[0] + 1.0)), self.profile.reach_mm)
        for number, at, row in zip(numbers.tolist(), ready, seen.reshape(-1, samples), strict=True):
            if at >= FOREVER:
                break
            # With a period it can be taken back.
            data = self._pack(number % self.profile.slots, row, self.motor.rpm(at))
            self._queue.push(data, at, size=len(data), period=1)
        stream.packets += _TOGETHER
        stream.ready = following


class PacedByTime(Talker[ProfileT]):
    """One that takes its samples at equal times."""

    @abstractmethod
    def _pack(self, turns: Floats, seconds: Floats, rpm: float) -> bytes:
        """Packets of one size, by where the rotor stood and when; shape (packets, samples)."""

    def _begin(self, origin: int) -> None:
        self._stream = Running(origin, 0, self._made_at(origin, 0))

    def _made_at(self, origin: int, packet: int) -> int:
        return origin + round((packet + 1) * self.profile.samples * 1e9 / self.profile.rate)

    def _make(self, stream: Running) -> None:
        rows, sample_ns = (_TOGETHER, self.profile.samples), 1e9 / self.profile.rate
        first = stream.packets * self.profile.samples
        turns, times = self.motor.sampled(stream.origin, first, _TOGETHER * self.profile.samples, sample_ns)
        data = self._pack(turns.reshape(rows), times.reshape(rows) * 1e-9, self.motor.rpm(int(times[0])))
        period = round(self.profile.samples * 1e9 / self.profile.rate)
        self._queue.push(data, stream.ready, size=len(data) // _TOGETHER, period=period)
        stream.packets += _TOGETHER
        stream.ready = self._made_at(stream.origin, stream.packets)


def folded(body: bytes) -> bytes:
    """The check value of fifteen bits that several makers of turrets put behind little-endian words."""
    total = 0
    for at in range(0, len(body), 2):
        total = 2 * total + body[at] + 256 * body[at + 1]
    return ((total % 32768 + total // 32768) % 32768).to_bytes(2, "little")


def within(millimetres: Floats, reach: tuple[float, float]) -> Floats:
    """What a device of that reach sees of these distances: 0 where it sees nothing."""
    nearest, farthest = reach
    return np.where((millimetres >= nearest) & (millimetres <= farthest), millimetres, 0.0)
