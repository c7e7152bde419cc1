"""The one interface through which the session uses every family of devices.

A family consists of scripts: generators that yield a `Request` and are resumed with the payload of its response
(empty bytes where there is none, the response type where a stream begins). So a whole sequence of requests is
written in order and yet does no I/O. The session runs the scripts, keeps the timing each request demands, and
throws `ResponseTimeout` into a script whose request had no response, which a script may catch to fall back on
something else.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

from lidario.errors import Unsupported
from lidario.families.samples import DecodedRevolution, Decoder, Samples
from lidario.families.stream import Keepalive, Known, RawStream, Stream, raw_stream
from lidario.model import DeviceInfo, Health, NetworkAddress, SampleRate, ScanMode
from lidario.wire.envelope import Request, encode_descriptor
from lidario.wire.events import Descriptor
from lidario.wire.formats import StreamFormat

if TYPE_CHECKING:
    from lidario.sim.chassis import Chassis
    from lidario.sim.device import SimulatedDevice
    from lidario.sim.world import WorldLike

__all__ = [
    "DecodedRevolution",
    "Decoder",
    "Device",
    "Family",
    "Keepalive",
    "Known",
    "NamedModel",
    "RawStream",
    "Samples",
    "Script",
    "Stream",
    "Timing",
    "raw_stream",
]

T = TypeVar("T")
Script: TypeAlias = Generator[Request, bytes, T]


@dataclass(frozen=True, slots=True)
class Timing:
    """How long the devices of a family take."""

    quiet_s: float  # silence after a STOP that proves the stream has ended
    boot_s: float  # longest time from RESET until the device responds
    forget_s: float  # how long a device may hold half a request before it forgets it
    drain_s: float = 0.5  # longest time that silence may take before STOP is sent again
    boot_poll_s: float = 0.25  # how often a device that was reset is asked
    starts_s: float = 0.0  # how long one may send nothing that was just started, and responds by its stream alone


class Device(ABC):
    """One device of a family: what it is, as far as asked, and how to talk to it. No I/O."""

    can_keep_spinning: bool = True  # whether the motor can go on when the laser is stopped
    can_be_stopped: bool = True  # whether laser and motor can be switched off from here
    # Speed of its line; 0 where that has none, as in a network, and None where it is not known.
    baudrate: int | None = None
    sends_bytes: bool = True  # whether its stream consists of bytes that can be decoded again; else of whole scans
    can_only_talk: bool = False  # whether it may be one that hears nothing, of a family whose others respond
    # Whether its family or model is only looked for, and no user has named it: what the device says of itself
    # counts more.
    is_guess: bool = False
    # Seconds between two signs of life, of one that may be well and yet silent for longer than others.
    rests_s: float = 0.0
    # What it has not told of its modes, for the log, once it was asked; empty where nothing is amiss.
    modes_note: str = ""
    # Bytes that complete any request that was half written, and begin none. Default: none are needed.
    fill: Request = Request("FILL", b"")
    # The slowest and the fastest scan frequency that can be set, in Hz, of one that need not be asked for them.
    speeds: tuple[float, float] | None = None

    @abstractmethod
    def stop(self) -> Request:
        """End the stream; the motor may go on."""

    def halt(self) -> tuple[Request, ...]:
        """End the stream and switch laser and motor off, in an order the device obeys without a pause.

        Default: what ends the stream does all that can be done.
        """
        return (self.stop(),)

    def halt_unknown(self) -> tuple[Request, ...]:
        """What else may stop the motor of a device that has not said what it is. Default: nothing.

        It is written when the line is quiet, before the port is closed: it may keep the device from hearing.
        """
        return ()

    def reset(self) -> Request:
        """Restart the device. Default: raises Unsupported."""
        raise Unsupported("this device cannot be restarted from here: cut its power")

    def restarted(self) -> None:  # noqa: B027 - most devices keep, or are told with each start, what matters
        """Take note that the device was restarted: what was set in it may be lost. Default: nothing."""

    def explain_silence(self, lasted_s: float) -> Script[bool]:  # noqa: ARG002
        """Find out why a stream fell silent although the device is well; it has `lasted_s`, 0 without a packet.

        Returns whether a cause was found that the next start avoids. Default: False.
        """
        yield from ()
        return False

    def respond(self, request: bytes, head: Descriptor, payload: bytes = b"") -> bytes:  # noqa: ARG002
        """The bytes that respond to a request, or announce a stream, where a recording of it is played as a device.

        Default: `head`, then the payload.
        """
        return encode_descriptor(head) + payload

    @abstractmethod
    def identify(self) -> Script[DeviceInfo]:
        """Ask what the device is; the other scripts rely on it having been asked once."""

    def overhear(self) -> Script[DeviceInfo]:
        """As `identify`, of a device that goes on sending although it was told to stop. Default: the same."""
        return self.identify()

    def complete_probe(self) -> bytes:
        """What to write after an identifying request that had no response.

        A device of another family, on a line whose speed does not matter, may take that request for the beginning
        of a longer one, and would hear nothing until that is complete. Default: nothing.
        """
        return b""

    def end_search(self) -> bytes:
        """What stops it at the end of a search that may have started it in vain. Default: nothing does."""
        return b""

    @abstractmethod
    def health(self) -> Script[Health]:
        """Ask how the device is."""

    @abstractmethod
    def modes(self) -> Script[tuple[ScanMode, ...]]:
        """Ask which scan modes there are; never empty."""

    def unlisted_modes(self) -> tuple[ScanMode, ...]:
        """Scan modes that the device does not list, but that can be asked for by name. Default: none."""
        return ()

    def load(self, mode: ScanMode) -> float:  # noqa: ARG002
        """Bytes a second that a mode sends; NaN where that is not known. Default: not known."""
        return math.nan

    @abstractmethod
    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        """Start the motor where that is a request of its own, then the stream.

        With `force` the device is asked to measure even when the motor has not reached its speed. Raises
        Unsupported where it has no such mode, or cannot be forced.
        """

    def sample_rate(self) -> Script[SampleRate]:
        """Ask how long a sample takes."""
        raise Unsupported("this device does not tell its sample rate: Scan.time_increment_ns is what is measured")

    def scan_frequency(self) -> Script[float]:
        """Ask which scan frequency is set, in Hz."""
        raise Unsupported("this device does not tell its scan frequency")

    def scan_frequency_range(self) -> Script[tuple[float, float]]:
        """Ask for the slowest and the fastest scan frequency that can be set, in Hz. Default: `speeds`."""
        yield from ()
        if self.speeds is None:
            raise Unsupported("the scan frequency of this device cannot be set")
        return self.speeds

    def set_scan_frequency(self, hertz: float) -> Script[float]:  # noqa: ARG002
        """Set the scan frequency; returns what was set, in Hz.

        Raises InvalidValue where it is not a finite number, or outside of what the device can.
        """
        raise Unsupported("the scan frequency of this device cannot be set from here")

    def retune(self) -> Request | None:
        """What has a stream that runs follow the scan frequency that was set. Default: nothing is needed."""
        return None

    def zero_offset(self) -> Script[float]:
        """Ask for the angle between the device's zero and the one it was calibrated to, in degrees."""
        raise Unsupported("this device knows no zero-angle offset")

    def apply_zero_offset(self, on: bool) -> Script[float]:  # noqa: ARG002
        """Choose whether streams have the zero-angle offset added; returns what is added, clockwise degrees."""
        raise Unsupported("this device knows no zero-angle offset")

    def network_address(self) -> Script[NetworkAddress]:
        """Ask for the address that an Ethernet model has been given."""
        raise Unsupported("this device has no network address")

    def set_network_address(self, address: NetworkAddress) -> Script[None]:  # noqa: ARG002
        """Give an Ethernet model another address, which it takes when it is restarted."""
        raise Unsupported("this device has no network address")

    def set_baudrate(self, baudrate: int, present: int) -> Script[None]:  # noqa: ARG002
        """Have device and port change the speed of the line. Raises Unsupported where the device does not follow.

        Where it fails, the session has the port return from `baudrate` to `present`.
        """
        raise Unsupported("the speed of this device's line cannot be changed from here")

    def power_down_protection(self, on: bool) -> Script[bool]:  # noqa: ARG002
        """Switch power-down protection; returns the state the device confirms."""
        raise Unsupported("this device knows no power-down protection")


class NamedModel(NamedTuple):
    """A model that a user may name."""

    baudrates: tuple[int, ...]  # speeds that its line may have, the likeliest first
    device: Callable[[], Device]  # makes the object for a newly opened port


@dataclass(frozen=True, slots=True)
class Family:
    """One row of the registry."""

    name: str  # short name, as in ``family=`` of a source; its folder is called so, too
    title: str  # name for people
    baudrates: tuple[int, ...]  # line speeds its models use, the likeliest first
    timing: Timing  # how long its devices take
    device: Callable[[], Device]  # makes the object for a newly opened port
    # The format and the decoder of a stream in a mode that was stored; None where they are not known.
    stream_in: Callable[[ScanMode], tuple[StreamFormat, Decoder] | None]
    # Every packet format that is listened for, where it is not known what sends.
    formats: tuple[Callable[[], StreamFormat], ...]
    # Finds the measurement stream in recorded bytes, by these and by what a user says of them, whose model, if any,
    # is one of `models`. None where there is no stream.
    find_stream: Callable[[memoryview, Known], RawStream | None]
    # Its models that may be named, as in ``model=`` of a source, where the device cannot tell its own.
    models: Mapping[str, NamedModel] = field(default_factory=dict, hash=False)
    # Line speeds at which a silent device may hear a request; at others, devices only talk. None for all speeds.
    asked_at: tuple[int, ...] | None = None
    # Those of `models` that are dark while the control line DTR is cleared, as it is when a port opens, and how
    # many seconds each may take to respond behind the request that asserts it. They are looked for last.
    by_dtr: Mapping[str, float] = field(default_factory=dict, hash=False)

    @property
    def simulated(self) -> tuple[str, ...]:
        """Names of its simulated models, which begin with its own. Users of a real device load no code of them."""
        return tuple(self._simulation().PROFILES)

    def make(self, model: str | None = None) -> Device:
        """A device for a newly opened port; `model` is one of `models`, None where it was not named."""
        return self.device() if model is None else self.models[model].device()

    def simulate(
        self,
        model: str,
        *,
        world: WorldLike | None = None,
        serial: bytes | None = None,
        seed: int = 0,
        spin_up: float | None = None,
    ) -> SimulatedDevice:
        """Make a simulated device of one of the models `simulated`; its arguments are those of `lidario.simulate`.

        Raises ValueError where no model has that name, or the serial number is none of this family.
        """
        device: Chassis[Any, Any] = self._simulation().make_simulated(model, world=world, serial=serial, seed=seed)
        if spin_up is not None:
            device.spin_up_s = spin_up
        return device

    def describe(self, model: str) -> str:
        """What a simulated model is, in a few words."""
        words: str = self._simulation().PROFILES[model].about
        return words

    def _simulation(self) -> Any:
        """The module of its simulated devices."""
        return import_module(f"lidario.families.{self.name}.simulated.device")
