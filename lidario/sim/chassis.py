"""What every simulated device is built on: a motor, a line, a log, and the ways in which it can be made to fail.

A family's device adds the requests it knows and the responses it sends; `SimulatedDevice` describes the whole.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Generic, Protocol, TypedDict, TypeVar, Unpack

import numpy as np

from lidario.sim.line import RequestLog, TransmitQueue
from lidario.sim.motor import Motor
from lidario.sim.rooms import make_world
from lidario.sim.world import CheckedWorld, World, WorldLike, as_world

PROTECTION_STOP = 2
"""The health status of a device that has stopped because of an error; the same number in every family so far."""

FOREVER = 1 << 62  # nanoseconds; more than a century

StreamT = TypeVar("StreamT")
DeviceT = TypeVar("DeviceT", covariant=True)
NamedT = TypeVar("NamedT", bound="Named")


class Named(Protocol):
    """What a device is: `model` decides, with the seed, what is random."""

    @property
    def name(self) -> str: ...
    @property
    def model(self) -> int: ...
    @property
    def baudrate(self) -> int: ...


class Making(TypedDict, total=False):
    """What may be said of one device, beside what it is; as for `lidario.simulate`."""

    world: WorldLike | None
    serial: bytes | None
    seed: int


class Chassis(ABC, Generic[NamedT, StreamT]):
    """The parts of a simulated device that are the same in every family; it is what its `profile` says.

    Attributes:
        health: Status and error code, as it tells them.
        faults_cleared_by_reset: Whether RESET cures an error.
        response_delay_s: Seconds from a request to the beginning of its response; raise it for late responses.
        boot_s: Seconds of silence after RESET.
        garble_responses: How many of the next responses to queries are replaced by random bytes.
        wrong_responses: Share of the responses to queries in whose place the response before is repeated.
        mute: While true nothing leaves the device, and its bytes are lost.
        motor: What turns its head; a test may change what it does.
        log: Every request so far, as `SimulatedDevice.log`.
    """

    def __init__(self, profile: NamedT, **making: Unpack[Making]) -> None:
        seed, world = making.get("seed", 0), making.get("world")
        self.profile: NamedT = profile
        self._random = np.random.default_rng([seed, profile.model])
        self._world = make_world(seed=seed) if world is None else as_world(world)
        self.health: tuple[int, int] = (0, 0)
        self.faults_cleared_by_reset = True
        self.response_delay_s: float = 0.001
        self.boot_s: float = 1.0
        self.garble_responses: int = 0
        self.wrong_responses: float = 0.0
        self._response_before = b""
        self.mute = False
        self.motor: Motor = Motor()
        self._queue = TransmitQueue(profile.baudrate)
        self.log: RequestLog = RequestLog()
        self._stream: StreamT | None = None
        self._deaf_until, self._deaf_why = 0, ""
        self._outstanding_until, self._outstanding_request = 0, ""
        self._now = 0

    @property
    def world(self) -> World | CheckedWorld:
        """What it sees from the next scan on; the results of a world that is not ours are checked."""
        return self._world

    @world.setter
    def world(self, world: WorldLike) -> None:
        self._world = as_world(world)

    @property
    def baudrate(self) -> int:
        return self.profile.baudrate

    @property
    def scanning(self) -> bool:
        return self._stream is not None

    @property
    def motor_on(self) -> bool:
        return self.motor.target_rpm > 0.0

    @property
    def spin_up_s(self) -> float:
        """Seconds the motor needs from standstill to a stable speed, from its next command on; 0 = none."""
        return self.motor.spin_up_s

    @spin_up_s.setter
    def spin_up_s(self, seconds: float) -> None:
        self.motor.spin_up_s = seconds

    def receive(self, data: bytes, now: int) -> None:
        """As `SimulatedDevice.receive`."""
        self._advance(now)
        self._hear(data, now)

    def _hear(self, data: bytes, now: int) -> None:
        """Take bytes that the host sent; what was due before is done. Default: a device that hears nothing."""

    def wakeup(self, now: int) -> int | None:
        """When the next response or packet will have left; None while the device is idle."""
        at = self._queue.wakeup(now)
        if at is None and self._stream is not None:
            at = max(now, self._due(self._stream))
        return at

    def transmit(self, now: int) -> bytes:
        self._advance(now)
        data = self._queue.take(now)
        return b"" if self.mute else data

    def reboot(self, now: int, *, off_s: float = 0.0) -> None:
        """Be without power for `off_s` seconds from `now` on, then boot.

        What has not left the device by `now` is lost, in the middle of a packet if need be. Until it has booted it
        obeys nothing. Then it is as after power-up.
        """
        self._advance(now)
        self._restart(now, now + round((off_s + self.boot_s) * 1e9))

    def freeze(self, now: int) -> None:
        """From `now` on neither send nor obey anything, until the next `reboot`; the rotor goes on turning."""
        self._advance(now)
        self._forget(now)
        self._deaf_until, self._deaf_why = FOREVER, "frozen"

    def protection_stop(self, error_code: int) -> None:
        """Fail: the stream and the motor stop, and health reports the error until a RESET clears it."""
        self.health = (PROTECTION_STOP, error_code)
        self.halt(self._now)

    def halt(self, now: int) -> None:
        """End the stream and stop the motor; the packet that is made still leaves."""
        self._end_stream(now)
        self._stop_motor(now)

    def _stop_motor(self, now: int) -> None:
        self.motor.set_rpm(0.0, now)

    def _end_stream(self, now: int) -> None:
        """Stop measuring; the packets made by now still leave."""
        if self._stream is not None:
            self._stream = None
            self._queue.withdraw(now)

    def _response_at(self, now: int) -> int:
        """When the response to a request that ends at `now` begins to leave."""
        return now + int(self.response_delay_s * 1e9)

    def _forget(self, now: int) -> None:
        """Drop the stream, the responses and the bytes that have not left."""
        self._end_stream(now)
        self._queue.cut(now)
        self._outstanding_until = 0

    def _garbled(self, response: bytes) -> bytes:
        """A response as it leaves: itself, unless `garble_responses` or `wrong_responses` asks for another."""
        before, self._response_before = self._response_before, response
        if self.garble_responses:
            self.garble_responses -= 1
            return self._random.bytes(len(response))
        if self.wrong_responses and self._random.random() < self.wrong_responses:
            return before or response
        return response

    def _respond(self, response: bytes, now: int, request: str) -> int:
        """Respond to a request that ends at `now`, be it by a descriptor; returns when that begins to leave."""
        at = self._response_at(now)
        self._queue.push(response, at)
        self._outstanding_until, self._outstanding_request = self._queue.free_at, request
        return at

    def _outstanding(self, now: int) -> str:
        """Which response has not left completely by `now`, in the words of the log; empty when none."""
        is_outstanding = now < self._outstanding_until
        return f"while the response to {self._outstanding_request} is outstanding" if is_outstanding else ""

    @abstractmethod
    def _advance(self, now: int) -> None:
        """Do what is due by `now`."""

    @abstractmethod
    def _due(self, stream: StreamT) -> int:
        """When the next packet that is not made yet will be."""

    def _reset(self, now: int) -> None:
        self._restart(now, now + round(self.boot_s * 1e9))
        self._deaf_why = "still booting after reset"

    def _restart(self, now: int, up: int) -> None:
        """Restart at `now`, and obey nothing until `up`, when the device has booted."""
        self._forget(now)
        if self.faults_cleared_by_reset:
            self.health = (0, 0)
        self._stop_motor(now)
        self._deaf_until, self._deaf_why = up, "still booting"


class Maker(Protocol[DeviceT]):
    """Builds the simulated devices of a family by their names."""

    def __call__(self, model: str, **making: Unpack[Making]) -> DeviceT:
        """Build one; ValueError where no model has that name, or the serial number is none of this family."""
        ...


def by_name(*profiles: NamedT) -> dict[str, NamedT]:
    """What the simulated devices of a family are, by their names."""
    return {profile.name: profile for profile in profiles}


def maker(build: Callable[..., DeviceT], profiles: Mapping[str, Any]) -> Maker[DeviceT]:
    """What builds the devices of a family: `build` is called with one of its `profiles`, by name."""

    def make_simulated(model: str, **making: Unpack[Making]) -> DeviceT:
        if model not in profiles:
            raise ValueError(f"no simulated device is called {model!r}; there are {', '.join(profiles)}")
        return build(profiles[model], **making)

    return make_simulated
