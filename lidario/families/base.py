"""The one interface through which the session uses every family of devices.

A family consists of scripts: generators that yield a `Request` and are resumed with the payload of its response
(empty bytes if there is none, the response type if a stream begins). So a sequence of requests is written in order
and yet does no I/O. The session runs the scripts and keeps the timing that each request demands. If a request has
no response, it throws `ResponseTimeout` into the script, which may catch it to try something else.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

from lidario.basics.model import DeviceInfo, Health, NetworkAddress, SampleRate, ScanMode
from lidario.errors import Unsupported
from lidario.families.samples import DecodedRevolution, Decoder, Samples
from lidario.families.stream import Keepalive, Known, RawStream, Stream, raw_stream, runs_in
from lidario.wire.envelope import Request, encode_descriptor
from lidario.wire.events import Descriptor
from lidario.wire.formats import StreamFormat

if TYPE_CHECKING:
    from lidario.sim.chassis import Chassis
    from lidario.sim.device import SimulatedDevice
    from lidario.sim.world import WorldLike

__all__ = [
    "DecodedRevolution", "Decoder", "Device", "Family", "Keepalive", "Known", "NamedModel", "RawStream",
    "Samples", "Script", "Stream", "T", "Timing", "raw_stream", "runs_in",
]  # fmt: skip

T = TypeVar("T")
Script: TypeAlias = Generator[Request, bytes, T]


@dataclass(frozen=True, slots=True)
class Timing:
    """How long the devices of a family take."""

    quiet_s: float  # silence after a STOP that proves the stream has ended
    boot_s: float  # longest time from RESET until the device responds
    forget_s: float  # how long a device may hold half a request before it forgets it
    drain_s: float = 0.5  # longest wait for silence before STOP is sent again
    # How long a device that was just started may send nothing, if it responds by its stream alone.
    starts_s: float = 0.0


class Device(ABC):
    """One device of a family: what it is, as far as known, and how to talk to it. No I/O."""

    can_keep_spinning: bool = True  # whether the motor can go on when the laser is stopped
    can_be_stopped: bool = True  # whether laser and motor can be switched off from here
    motor_obeys: bool = True  # whether the motor is then off, too; else it turns while it has power
    baudrate: int | None = None  # speed of its line; 0 if the line has none, as a network; None if unknown
    sends_bytes: bool = True  # whether its stream consists of bytes that can be decoded again; else of whole scans
    can_only_talk: bool = False  # whether it may be a device that hears nothing, in a family whose others respond
    # Whether its family or model was guessed in a search, and no user has named it. What the device says of itself
    # then counts more.
    is_guess: bool = False
    # Seconds between two signs of life, if a healthy device may be silent for longer than others.
    rests_s: float = 0.0
    # A note for the log about modes that the device, when asked, has not told; empty if all is well.
    modes_note: str = ""
    # Bytes that complete any request that was half written, and begin none. Default: none are needed.
    fill: Request = Request("FILL", b"")
    # Questions that change nothing, the shortest first, by which it is seen that a device hears. Default: none.
    questions: tuple[Request, ...] = ()
    # The slowest and the fastest scan frequency that can be set, in Hz, if they are known without asking the
    # device.
    speeds: tuple[float, float] | None = None

    @abstractmethod
    def stop(self) -> Request:
        """End the stream; the motor may go on."""

    def halt(self) -> tuple[Request, ...]:
        """End the stream and switch laser and motor off, in an order the device obeys without a pause.

        Default: only the request that ends the stream.
        """
        return (self.stop(),)

    def halt_unknown(self) -> tuple[Request, ...]:
        """Further requests that may stop the motor of a device that has not said what it is. Default: none.

        They are written last, when the line is quiet and before the port is closed: they may keep the device from
        hearing anything else.
        """
        return ()

    def reset(self) -> Request:
        """Restart the device. Default: raises Unsupported."""
        raise Unsupported("this device cannot be restarted from here: cut its power")

    def restarted(self) -> None:  # noqa: B027 - most devices keep, or are told with each start, what matters
        """Take note that the device was restarted: what was set in it may be lost. Default: nothing."""

    def explain_silence(self, lasted_s: float) -> Script[bool]:  # noqa: ARG002
        """Find out why a stream fell silent although the device is well.

        The stream had lasted `lasted_s` seconds, 0 without a packet. Returns whether a cause was found that the
        next start avoids. Default: False.
        """
        yield from ()
        return False

    def respond(self, request: bytes, head: Descriptor, payload: bytes = b"") -> bytes:  # noqa: ARG002
        """The bytes with which a device, played from a recording, responds to a request or announces a stream.

        Default: `head`, then the payload.
        """
        return encode_descriptor(head) + payload

    @abstractmethod
    def identify(self) -> Script[DeviceInfo]:
        """Ask what the device is. This script must run once before the others."""

    def overhear(self) -> Script[DeviceInfo]:
        """As `identify`, for a device that goes on sending although it was told to stop. Default: the same."""
        return self.identify()

    def complete_probe(self) -> bytes:
        """Bytes to write after an identifying request that had no response. Default: none.

        A device of another family, on a line whose speed does not matter, may take that request for the beginning
        of a longer one. It would hear nothing until the longer one is complete.
        """
        return b""

    def end_search(self) -> bytes:
        """Bytes that stop the device at the end of a search that may have started it in vain. Default: none."""
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
        """Bytes a second that a mode sends; NaN if unknown, as by default."""
        return math.nan

    @abstractmethod
    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        """Start the motor, if that is a request of its own, then the stream.

        With `force` the device is asked to measure even while the motor has not reached its speed. Raises
        Unsupported if the device has no such mode, or cannot be forced.
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

        Raises InvalidValue if it is not a finite number, or outside the range of the device.
        """
        raise Unsupported("the scan frequency of this device cannot be set from here")

    def retune(self) -> Request | None:
        """The request that makes a running stream follow the scan frequency that was set. Default: none."""
        return None

    def zero_offset(self) -> Script[float]:
        """Ask for the angle between the device's zero and the one it was calibrated to, in degrees."""
        raise Unsupported("this device knows no zero-angle offset")

    def apply_zero_offset(self, on: bool) -> Script[float]:  # noqa: ARG002
        """Choose whether the zero-angle offset is added in streams; returns what is added, clockwise degrees."""
        raise Unsupported("this device knows no zero-angle offset")

    def network_address(self) -> Script[NetworkAddress]:
        """Ask for the network address that is set in an Ethernet model."""
        raise Unsupported("this device has no network address")

    def set_network_address(self, address: NetworkAddress) -> Script[None]:  # noqa: ARG002
        """Set another network address in an Ethernet model, which uses it after a restart."""
        raise Unsupported("this device has no network address")

    def set_baudrate(self, baudrate: int, present: int) -> Script[None]:  # noqa: ARG002
        """Change the speed of the line of device and port. Raises Unsupported if the device does not follow.

        If it fails, the session sets the port back from `baudrate` to `present`.
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
    # Gives the format and the decoder of a stream for a stored mode; None if they are not known.
    stream_in: Callable[[ScanMode], tuple[StreamFormat, Decoder] | None]
    formats: tuple[Callable[[], StreamFormat], ...]  # every packet format to listen for, if the device is not known
    # Finds the measurement stream in recorded bytes, by the bytes and by what a user says about them. The model
    # that a user names must be one of `models`. None if there is no stream.
    find_stream: Callable[[memoryview, Known], RawStream | None]
    # Models that a user may name, as in ``model=`` of a source, because the device cannot tell its own.
    models: Mapping[str, NamedModel] = field(default_factory=dict, hash=False)
    # Line speeds at which a silent device may hear a request; at others, devices only talk. None for all speeds.
    asked_at: tuple[int, ...] | None = None
    # Those of `models` that stay silent while the control line DTR is cleared, as it is when a port opens. For
    # each, how many seconds it may take to respond after the request that asserts DTR. They are looked for last.
    by_dtr: Mapping[str, float] = field(default_factory=dict, hash=False)

    @property
    def simulated(self) -> tuple[str, ...]:
        """Names of its simulated models, which begin with its own. Users of a real device load no code of them."""
        return tuple(self._simulation().PROFILES)

    def make(self, model: str | None = None) -> Device:
        """A device for a newly opened port; `model` is one of `models`, or None if no user has named it."""
        return self.device() if model is None else self.models[model].device()

    def simulate(
        self,
        model: str,
        *,
        world: "WorldLike | None" = None,
        serial: bytes | None = None,
        seed: int = 0,
        spin_up: float | None = None,
    ) -> "SimulatedDevice":
        """Make a simulated device of one of the models `simulated`; its arguments are those of `lidario.simulate`.

        Raises ValueError if no model has that name, or the serial number is none of this family.
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
        return import_module(f"lidario.families.{self.name}.simulated")
