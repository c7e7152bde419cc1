"""One YDLIDAR: what its responses mean, and how it is started and set. What varies is in `models`.

Payloads: 4ROS development manual, figures 10, 12 and 13 to 15. Where it contradicts what is seen elsewhere:

* Firmware: the manual's two bytes read as minor, major here, although it names the first one major. The SDK
  reads them so, and so do logs of its users and an independent driver.
* Health: the manual asks by A5 91, the SDK by A5 92. The manual's is tried first, then the other one.
* "Old" firmware (1.2 and below): the SDK halves all distances of models 100 to 102 then. It is not done here:
  the manual knows only whole millimetres, and a version read in the wrong order would halve every distance.

The motor has neither a pin nor a request of its own: a scan starts it, STOP stops it.

Some models only talk (`Model.one_way`). One that was not named is known by that it goes on sending after two STOPs,
and says nothing.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from functools import partial
from typing import Final, TypeVar

from lidario.errors import ResponseTimeout, Unsupported
from lidario.families.base import Keepalive, NamedModel, Script, Stream
from lidario.families.scripts import NOT_STOPPED, agreed, begin, health_of, hear, hear_runs, told
from lidario.families.ydlidar import commands
from lidario.families.ydlidar.formats import PointCloud
from lidario.families.ydlidar.models import FOUR_ROS, MODELS, ONE_WAY, Model, model_of
from lidario.families.ydlidar.raw import turn_in
from lidario.families.ydlidar.settings import SettableDevice
from lidario.model import DeviceInfo, Health, HealthStatus, ScanMode
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor

T = TypeVar("T")
SPIN_UP_S: Final = 4.0
"""No document says how long the motor takes; 2.5 s are assumed, and a margin added."""
SLOWEST_TURN_S: Final = 0.5
"""One revolution at the lowest speed that a start packet can tell, 3 Hz, and half as long again."""
KEEPALIVE_S: Final = 0.4
"""The manual demands less than 3 s; the SDK repeats every second. A program that blocks its event loop for 2.5 s
may begin to do so just before the next one is due, and must not stop the device by that."""
HEAR_S: Final = 0.5
BY_DTR_S: Final = 1.0
"""How long a motor that DTR has switched on may take until packets come, besides the 0.5 s that `DTR_TURNS` waits.
An assumption: no data sheet tells it. The vendor's SDK discards the points of the first 1.0 to 1.5 s after a start,
so points do come by then."""
UNNAMED: Final = (
    "this model cannot tell what it is. It is read as an X2, which is right for an X3 and S2 Pro, too. The "
    "distances of a TX8 are four times as far: name the model, as in ?model=tx8, or ?model=x2"
)
OVERHEARD: Final = 8
MOST_A_TURN: Final = 1300
"""Samples a revolution above which no model only talks: the fastest of those has 1250 at 4 Hz."""


class YdlidarDevice(SettableDevice):
    """One YDLIDAR; `model` is the one that the user has named, if any."""

    def __init__(self, model: Model | None = None) -> None:
        super().__init__(model or FOUR_ROS)
        self._named = model
        self.can_only_talk: bool = model is None or model.one_way
        self._be(model or FOUR_ROS)
        self._code: int | None = None
        self._health_request: Request | None = None

    def _be(self, model: Model) -> None:
        self._model = model
        self.can_be_stopped: bool = not model.one_way or bool(model.dtr)
        # The motor of one that hears requests stops with its laser.
        self.can_keep_spinning: bool = model.one_way

    def stop(self) -> Request:
        return NOT_STOPPED if self._model.one_way else commands.STOP

    def halt(self) -> tuple[Request, ...]:
        # The forced stop that the SDK sends before each STOP, then the manual's STOP.
        stops = () if self._model.one_way else (commands.FORCED_STOP, commands.STOP)
        return (*stops, commands.DTR_STOPS) if self._model.dtr else stops or (NOT_STOPPED,)

    def reset(self) -> Request:
        if self._model.one_way:
            raise Unsupported("this device cannot be restarted from here: cut its power")
        return commands.RESET

    def respond(self, request: bytes, head: Descriptor, payload: bytes = b"") -> bytes:
        """As `Device.respond`; all models announce their stream alike."""
        return super().respond(request, commands.ANNOUNCED if head.continuous else head, payload)

    def identify(self) -> Script[DeviceInfo]:
        return self._awake(self._hear() if self._model.one_way else self._ask_info())

    def _ask_info(self) -> Script[DeviceInfo]:
        model, minor, major, hardware, serial = struct.unpack("<BBBB16s", (yield from agreed(commands.GET_INFO)))
        self._code, self._firmware = model, (major, minor)
        if self.is_guess and self._named is not None and model not in self._named.codes:
            self._named = None
        found = self._named or model_of(model, self.baudrate)
        if found is not None:
            self._be(found)
        return DeviceInfo(
            family="ydlidar",
            model=f"YDLIDAR {found.title}" if found else f"YDLIDAR (model {model})",
            model_id=model,
            firmware=f"{major}.{minor}",
            hardware=hardware,
            serial="".join(str(digit) if digit < 10 else f"[{digit:02x}]" for digit in serial),
        )

    def _awake(self, script: Script[T]) -> Script[T]:
        """Run a script with DTR as it must be; it is cleared at rest. No model that needs that has settings."""
        if self._model.dtr:
            yield commands.DTR_TURNS
        return (yield from script)

    def overhear(self) -> Script[DeviceInfo]:
        """As `Device.overhear`: one whose STOP was lost responds after another; one that only talks does not."""
        for _ in range(0 if self._model.one_way else 2):
            yield commands.STOP
            try:
                yield _SHORT_INFO
            except ResponseTimeout:
                continue
            return (yield from self.identify())
        if self._named is not None and not self._named.one_way:
            raise ResponseTimeout(commands.GET_INFO.name, HEAR_S)
        return (yield from self._hear())

    def _hear(self) -> Script[DeviceInfo]:
        model = self._named or ONE_WAY
        runs = yield from hear_runs(model.kind.wire, OVERHEARD, BY_DTR_S if model.dtr else HEAR_S)
        heard = memoryview(b"".join(runs))
        if self._named is None and turn_in(heard, model.kind.wire()).samples > MOST_A_TURN:
            raise ResponseTimeout(commands.GET_INFO.name, HEAR_S)
        self._be(model)
        return DeviceInfo("ydlidar", f"YDLIDAR {model.title}", model.code, "", 0, "")

    def complete_probe(self) -> bytes:
        return commands.COMPLETE_INFO

    def health(self) -> Script[Health]:
        return self._awake(self._hear_health() if self._model.one_way else self._ask_health())

    def _hear_health(self) -> Script[Health]:
        yield hear(self._model.kind.wire(), timeout=BY_DTR_S if self._model.dtr else HEAR_S)
        return Health(HealthStatus.OK, 0, UNNAMED if self._named is None else "")

    def modes(self) -> Script[tuple[ScanMode, ...]]:
        return told((self._model.mode,))

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        if force:
            raise Unsupported("a scan of this device cannot be forced")
        if self._named is None and self._code is not None and model_of(self._code) is None:
            names = sorted({(model.code, model.title) for model in MODELS.values() if not model.one_way})
            raise Unsupported(
                f"how model {self._code} measures is not known; lidario decodes models "
                + ", ".join(f"{code} ({name})" for code, name in names)
                + ". If it is like one of them, name that: ?model="
            )
        known = self._model.mode
        if (mode.id, mode.response_type) != (known.id, known.response_type):
            raise Unsupported(f"this device has one scan mode, {known.name!r}, and not {mode.name!r}")
        yield from self._be_as_set()
        stream = yield from self._awake(self._begin())
        return Stream(
            format=stream,
            decoder=self._model.kind.decoder(),
            mode=mode,
            sample_ns=known.sample_us * 1e3,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=SLOWEST_TURN_S,
            keepalive=Keepalive(commands.KEEPALIVE, KEEPALIVE_S) if self._protected else None,
            zero_offset_deg=self._offset_deg,
            may_take_ns=self._model.may_take_ns,
        )

    def _begin(self) -> Script[PointCloud]:
        """Have it send packets."""
        stream = self._model.kind.wire()
        if self._model.one_way:
            yield begin(stream)
            return stream
        try:
            yield commands.scan(stream)
        except ResponseTimeout:
            # A header that was lost is not repeated while packets flow: begin again from standstill.
            yield commands.STOP
            stream = self._model.kind.wire()
            yield commands.scan(stream)
        return stream

    def _ask_health(self) -> Script[Health]:
        known, both = self._health_request, (commands.GET_HEALTH, commands.GET_HEALTH_92)
        *questions, last = ((known,) if known else both[::-1] if self._model.health_by_92 else both) * 2
        for request in questions:
            try:
                payload = yield request
            except ResponseTimeout:
                continue
            break
        else:
            request = last
            try:
                payload = yield last
            except ResponseTimeout:
                self._health_request = None
                raise
        # Not forgotten before: who waits for its turn may be cancelled, or another task may ask meanwhile.
        self._health_request = request
        return (yield from health_of(request, payload))


_SHORT_INFO: Final = replace(commands.GET_INFO, timeout=0.25, attempts=1)


NAMED: Final = {
    name: NamedModel((model.baudrate,), partial(YdlidarDevice, model)) for name, model in MODELS.items()
}
