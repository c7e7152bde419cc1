"""One LDROBOT lidar: which model it is, how it is listened to, and the few requests that one model hears.

No packet tells the model, the firmware or a serial number. The rate of the samples does: the models of one rate are
not told apart, but they measure alike, except LD14 and LD08. Sample rates: LD06 as measured on a real device, the
others by data sheet. The rate that a device has is measured anew when it is opened.

The LD14P has requests (`commands`). It may have been stopped and be silent: then it is started to be found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import Final, NamedTuple

from lidario.errors import ResponseTimeout, Unsupported
from lidario.families.arguments import frequency_within
from lidario.families.base import NamedModel, Script, Stream, told
from lidario.families.ldrobot import commands
from lidario.families.ldrobot.decode import AxisDecoder, PacketDecoder, TriangleDecoder, samples_a_second
from lidario.families.ldrobot.formats import AxisFormat, PacketFormat, TriangleFormat
from lidario.families.unasked import UnaskedDevice, begin, hear_runs
from lidario.model import DeviceInfo, Health, ScanMode
from lidario.wire.envelope import Request

__all__ = ["AXIS", "BEAM", "KINDS", "MODELS", "NAMED", "TRIANGLE", "LdrobotDevice", "Model", "model_of_rate"]


class Kind(NamedTuple):
    """How the packets of some models are to be read.

    Attributes:
        wire: Makes their format.
        decoder: Makes their decoder.
        slowest_turn_s: Longest time that one revolution may take, in seconds: at the lowest speed, and half as long
            again.
    """

    wire: Callable[[], PacketFormat]
    decoder: Callable[[], PacketDecoder]
    slowest_turn_s: float


BEAM: Final = Kind(PacketFormat, PacketDecoder, 0.3)
"""Time of flight; 5 Hz."""
TRIANGLE: Final = Kind(TriangleFormat, TriangleDecoder, 0.75)
AXIS: Final = Kind(AxisFormat, AxisDecoder, 0.75)
"""Both triangulate; 2 Hz."""
KINDS: Final = (BEAM, TRIANGLE, AXIS)


@dataclass(frozen=True, slots=True)
class Model:
    """One model.

    Attributes:
        name: As in ``model=`` of a source.
        title: For people.
        baudrate: Speed of its line.
        rate: Samples a second.
        reach: Farthest distance in metres.
        kind: How its packets are to be read.
        commands: Whether it hears requests.
        note: What else it may be, where its rate is told by models that are to be read otherwise.
    """

    name: str
    title: str
    baudrate: int
    rate: float
    reach: float
    kind: Kind = BEAM
    commands: bool = False
    note: str = ""


MODELS: Final = {
    model.name: model
    for model in (
        Model("ld06", "LD06", 230_400, 4546, 12.0),
        Model("ld19", "LD19", 230_400, 4500, 12.0),
        Model("stl-06p", "STL-06P", 230_400, 5000, 12.0),
        Model("stl-19p", "STL-19P", 230_400, 4500, 12.0),
        Model("stl-26", "STL-26", 230_400, 5000, 12.0),
        Model("stl-27l", "STL-27L", 921_600, 21_600, 25.0),
        Model("ld08", "LD08", 115_200, 2300, 8.0, AXIS),
        Model("ld14", "LD14", 115_200, 2300, 8.0, TRIANGLE),
        Model("ld14p", "LD14P", 230_400, 4000, 8.0, TRIANGLE, commands=True),
    )
}
_LENS_UNKNOWN: Final = (
    "an LD14 and an LD08 send the same packets at the same rate. It is read as an LD14; the distances of an LD08 "
    "would be up to 60 mm short: name the model, as in ?model=ld08, or ?model=ld14"
)
_BY_RATE: Final = (
    (10_000, Model("", "STL-27L", 921_600, 21_600, 25.0)),
    (4250, Model("", "LD06, LD19 or alike", 230_400, 4546, 12.0)),
    (3150, MODELS["ld14p"]),
    (0, Model("", "LD14 or LD08", 115_200, 2300, 8.0, TRIANGLE, note=_LENS_UNKNOWN)),
)
"""The slowest rate of each kind."""
HEARD: Final = 24
"""Packets by which the rate is known to 0.5 % (by a recording of a real LD06). Of an LD14 0.13 s."""
HEAR_S: Final = 0.5
SPIN_UP_S: Final = 3.0
"""Users report 10 Hz within 3 s; the first packets come after 0.7 s."""
SPEED_RANGE: Final = (2.0, 8.0)
"""Hz, of the LD14P (the vendor's SDK: 720 to 2880 degrees a second)."""


def model_of_rate(rate: float) -> Model:
    """The model, or the models that are not told apart, with so many samples a second."""
    return next(model for slowest, model in _BY_RATE if rate >= slowest)


class LdrobotDevice(UnaskedDevice):
    """One LDROBOT lidar.

    Args:
        model: The model, where the user has named it.
    """

    def __init__(self, model: Model | None = None) -> None:
        self._named = model
        self._be(model or MODELS["ld06"])
        self._rate = self._model.rate
        self._wanted_speed: int | None = None

    def _be(self, model: Model) -> None:
        self._model = model
        self.can_be_stopped: bool = model.commands
        # Where it has requests, the motor stops with the laser.
        self.can_keep_spinning: bool = not model.commands
        self.wake: bytes = commands.START if model.commands else b""
        self.patience_s: float = SPIN_UP_S if model.commands else HEAR_S

    def wire(self) -> PacketFormat:
        return self._model.kind.wire()

    def stop(self) -> Request:
        return commands.STOP if self._model.commands else super().stop()

    def halt(self) -> tuple[Request, ...]:
        return (self.stop(),)

    def identify(self) -> Script[DeviceInfo]:
        """As `Device.identify`: by the rate of its packets. An LD14P that was stopped is started for that."""
        try:
            runs = yield from hear_runs(self.wire, HEARD, HEAR_S)
        except ResponseTimeout:
            if self._named is not None and not self._named.commands:
                raise
            runs = yield from hear_runs(self.wire, HEARD, SPIN_UP_S, commands.START)
        # The median, for a run with a damaged packet that its CRC does not find has any rate.
        self._rate = median(samples_a_second(run) for run in runs) or self._rate
        self._be(self._named or model_of_rate(self._rate))
        return DeviceInfo("ldrobot", f"LDROBOT {self._model.title}", 0, "", 0, "")

    def health(self) -> Script[Health]:
        """As `Device.health`: with a note where it may be another model."""
        health = yield from super().health()
        return replace(health, note=self._model.note)

    def modes(self) -> Script[tuple[ScanMode, ...]]:
        """As `Device.modes`: there is one."""
        kind = self.wire().response_type
        return told((ScanMode(0, "Standard", 1e6 / self._rate, self._model.reach, kind, typical=True),))

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        """As `Device.start`.

        Raises:
            Unsupported: A forced scan, or another device's mode.
        """
        wire = self.wire()
        if force or (mode.id, mode.response_type) != (0, wire.response_type):
            raise Unsupported("this device has one scan mode, 'Standard', and cannot be forced")
        yield begin(wire, self.wake)
        if self._wanted_speed is not None:
            yield commands.speed(self._wanted_speed)
        return Stream(
            format=wire,
            decoder=self._model.kind.decoder(),
            mode=mode,
            sample_ns=1e9 / self._rate,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=self._model.kind.slowest_turn_s,
        )

    def scan_frequency_range(self) -> Script[tuple[float, float]]:
        """As `Device.scan_frequency_range`; only of the LD14P."""
        return told(SPEED_RANGE) if self._model.commands else super().scan_frequency_range()

    def set_scan_frequency(self, hertz: float) -> Script[float]:
        """As `Device.set_scan_frequency`: the next start sets it; only of the LD14P. It cannot be read back.

        Raises:
            Unsupported: Another model: its speed is set by a pin that is not in the cable.
            InvalidValue: Not a finite number, or outside of 2 to 8 Hz.
        """
        if not self._model.commands:
            raise Unsupported("the scan frequency of this device cannot be set from here")
        return self._set_speed(round(frequency_within(hertz, SPEED_RANGE, self._model.title) * 360))

    def _set_speed(self, degrees_per_second: int) -> Script[float]:
        yield commands.speed(degrees_per_second)
        self._wanted_speed = degrees_per_second
        return degrees_per_second / 360


NAMED: Final = {name: NamedModel(model.baudrate, partial(LdrobotDevice, model)) for name, model in MODELS.items()}
"""As `Family.models`."""
