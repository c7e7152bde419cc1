"""One YDLIDAR: what its responses mean, how it is started, and what can be set. Differences are in `models`.

Payloads: 4ROS development manual, figures 10, 12 and 13 to 15. Where other sources contradict it:

* Firmware: its two bytes are read as minor, major, although the manual names the first one major. The SDK reads
  them so, and so do logs of its users and an independent driver.
* Health: the manual asks by A5 91, the SDK by A5 92. Both are tried; triangulating models are asked by A5 92 first.
* "Old" firmware (1.2 and below): the SDK then halves all distances of models 100 to 102. This is not done here: the
  manual knows only whole millimetres, and a version read in the wrong order would halve every distance.
* Set scan frequency: SDK 1.2.20 subtracts 0.4 Hz from what models 100 to 102 report, since "the speed reads 0.4 Hz
  high". So a device that reports 10.00 Hz and is asked for 10 Hz stays at 10.4 Hz. This is not imitated: the manual
  does not mention it, and scans show how fast the motor really turns.
* Zero-angle offset: the manual says neither which way it counts nor whether the stream contains it. The SDK adds it
  to every angle (clockwise degrees). So does `apply_zero_offset`, but only if it is asked for.

The motor has neither a pin nor a request of its own: a scan starts it, STOP stops it. Its speed is set in steps,
and power-down protection is toggled: neither can be set to a value. So each step is judged by the state that the
device reports, and a request whose response was lost is not repeated before that is known (manual, 3.5 and 3.8).

Some models only talk (`Model.one_way`). One that no user has named is recognised because it goes on sending after
two STOPs, without a response.
"""

import struct
from contextlib import suppress
from dataclasses import replace
from typing import Final

from lidario.basics.model import DeviceInfo, Health, HealthStatus, ScanMode
from lidario.errors import RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.base import Device, Keepalive, Script, Stream, T
from lidario.families.scripts import (
    HEAR_S,
    NOT_STOPPED,
    agreed,
    begin,
    frequency_within,
    health_of,
    hear,
    hear_runs,
    told,
)
from lidario.families.ydlidar import commands
from lidario.families.ydlidar.models import FOUR_ROS, MODELS, ONE_WAY, Model, model_of
from lidario.families.ydlidar.raw import turn_in
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor
from lidario.wire.formats import StreamFormat

SPIN_UP_S: Final = 4.0  # no document says how long the motor takes; 2.5 s are assumed, and a margin added
SLOWEST_TURN_S: Final = 0.5
"""One revolution at the lowest speed that a start packet can tell, 3 Hz, and half as long again."""
KEEPALIVE_S: Final = 0.4
"""The manual demands less than 3 s; the SDK repeats every second. A program may block its event loop for 2.5 s just
before the next keepalive is due, and must not stop the device by that."""
BY_DTR_S: Final = 1.5
"""How long a motor that DTR has switched on may take until packets come, after the 0.5 s that `DTR_TURNS` waits.
This is an assumption: no data sheet tells it. The vendor's SDK discards the points of the first 1.0 to 1.5 s after
a start, so points do come by then. In a search the X2 is asked last: its motor turns while others are asked."""
UNNAMED: Final = (
    "this model cannot tell what it is. It is read as an X2, which is right for an X3 and S2 Pro, too. The "
    "distances of a TX8 are four times as far: name the model, as in ?model=tx8, or ?model=x2"
)
OVERHEARD: Final = 8
MOST_A_TURN: Final = 1300
"""A model that only talks has at most this many samples a revolution: the fastest one has 1250 at 4 Hz."""
MOST_TOGGLES: Final = 4  # attempts; the SDK makes as many
LAPSE_S: Final = (2.5, 4.0)
"""Without a keepalive a stream ends 3 s after its start (manual 3.8). The last packets may be read half a second
later."""
_LEARN_PROTECTION: Final = replace(commands.TOGGLE_PROTECTION, timeout=0.5)
_SHORT_INFO: Final = replace(commands.GET_INFO, timeout=0.25, attempts=1)
_INFO_ONCE: Final = replace(_SHORT_INFO, timeout=HEAR_S)


class YdlidarDevice(Device):
    """One YDLIDAR; `model` is the one that the user has named, if any."""

    def __init__(self, model: Model | None = None) -> None:
        self._named = model
        self.can_only_talk: bool = model is None or model.one_way
        self._be(model or FOUR_ROS)
        self._code: int | None = None
        self._firmware = (0, 0)
        self._health_request: Request | None = None
        self._protected: bool | None = False  # whether protection is on; None after a toggle without a response
        self._offset_deg = 0.0
        # What the program has set, to be set again after a restart.
        self._wanted_protection: bool | None = None
        self._wanted_speed: int | None = None
        self._was_restarted = False

    def _be(self, model: Model) -> None:
        self._model = model
        self.can_be_stopped: bool = not model.one_way or model.dtr
        self.can_keep_spinning: bool = model.one_way  # in others the motor stops with the laser
        self.questions: tuple[Request, ...] = commands.QUESTIONS if model.hears_at_rest else ()
        # The limits of the data sheet, since the device cannot be asked.
        self.speeds: tuple[float, float] | None = model.speeds

    def stop(self) -> Request:
        return NOT_STOPPED if self._model.one_way else commands.STOP

    def halt(self) -> tuple[Request, ...]:
        # First the forced stop, which the SDK sends before each STOP, then the STOP of the manual.
        stops = () if self._model.one_way else (commands.FORCED_STOP, commands.STOP)
        return (*stops, commands.DTR_STOPS) if self._model.dtr else stops or (NOT_STOPPED,)

    def reset(self) -> Request:
        return super().reset() if self._model.one_way else commands.RESET

    def respond(self, request: bytes, head: Descriptor, payload: bytes = b"") -> bytes:
        """As `Device.respond`; all models announce their stream alike."""
        return super().respond(request, commands.ANNOUNCED if head.continuous else head, payload)

    def identify(self) -> Script[DeviceInfo]:
        return self._awake(self._hear() if self._model.one_way else self._ask_info())

    def _ask_info(self) -> Script[DeviceInfo]:
        told = [(yield commands.GET_INFO)]
        if self._named is None:
            try:
                told.append((yield _INFO_ONCE))
            except ResponseTimeout:
                # A device that only talks tells its code at power-on (X2 manual, 3): that was no response.
                with suppress(ResponseTimeout):
                    return (yield from self._hear())
        payload = yield from agreed(commands.GET_INFO, *told)
        model, minor, major, hardware, serial = struct.unpack("<BBBB16s", payload)
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
        """Run a script with DTR asserted if the model needs it (cleared at rest). No such model has settings."""
        if self._model.dtr:
            yield commands.DTR_TURNS
        return (yield from script)

    def overhear(self) -> Script[DeviceInfo]:
        """As `Device.overhear`: a device whose STOP was lost responds after another one; if not, it only talks."""
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
            may_take_ns=tuple(1e9 / rate for rate in self._model.rates),
        )

    def _begin(self) -> Script[StreamFormat]:
        """Start the stream; returns its format."""
        stream = self._model.kind.wire()
        if self._model.one_way:
            yield begin(stream)
            return stream
        try:
            yield commands.scan(stream)
        except ResponseTimeout:
            # If the header was lost, it is not repeated while packets flow: begin again from standstill.
            yield commands.STOP
            stream = self._model.kind.wire()
            yield commands.scan(stream)
        return stream

    def _ask_health(self) -> Script[Health]:
        known, both = self._health_request, (commands.GET_HEALTH, commands.GET_HEALTH_92)
        # An Arduino port that asks an X4 only by 91 fails, and the SDK asks all triangulating models by 92.
        questions = list((known,) if known else both[::-1] if self._model.code <= 23 else both) * 2
        while True:
            request = questions.pop(0)
            try:
                payload = yield request
            except ResponseTimeout:
                if questions:
                    continue
                self._health_request = None
                raise
            # It is only changed here: a task that waits for its turn may be cancelled, or another may ask
            # meanwhile.
            self._health_request = request
            return (yield from health_of(request, payload))

    def restarted(self) -> None:
        # The next start sets speed and protection again, if the program has set them.
        self._was_restarted = True
        self._protected = False

    def explain_silence(self, lasted_s: float) -> Script[bool]:
        """As `Device.explain_silence`: an earlier program may have left power-down protection on.

        Protection cannot be asked for, only be toggled: two toggles in a row tell it and leave it as it was. They
        are sent only if the device stopped when protection would have stopped it, so never without need.
        """
        earliest, latest = LAPSE_S
        is_lapse = not lasted_s or earliest <= lasted_s <= latest
        if not self._model.protection or self._protected or not is_lapse:
            return False
        yield from self._learn_protection()
        return bool(self._protected)

    def scan_frequency(self) -> Script[float]:
        """As `Device.scan_frequency`: the frequency that is set, not the one that the motor reaches."""
        if self.speeds is None:
            return (yield from super().scan_frequency())
        return (yield from commands.ask_speed()) / 100

    def set_scan_frequency(self, hertz: float) -> Script[float]:
        """As `Device.set_scan_frequency`: in steps of 1 and 0.1 Hz, then read back."""
        if self.speeds is None:
            # The speed of its motor depends on the supply, or on a pin that is not in the cable.
            return (yield from super().set_scan_frequency(hertz))
        hundredths = round(frequency_within(hertz, self.speeds, self._model.title) * 100)
        reached = yield from commands.step_to(hundredths)
        self._wanted_speed = hundredths
        return reached

    def zero_offset(self) -> Script[float]:
        # Clockwise degrees, if it counts as the SDK assumes.
        if not self._model.offset:
            return (yield from super().zero_offset())
        (parts,) = struct.unpack("<i", (yield from agreed(commands.GET_ZERO_OFFSET)))
        fine_above = self._model.fine_above
        degrees: float = parts / (100 if fine_above is not None and self._firmware > fine_above else 4)
        if abs(degrees) <= 360:
            return degrees
        raise RemoteProtocolError(f"the device reports a zero-angle offset of {degrees:g} degrees")

    def apply_zero_offset(self, on: bool) -> Script[float]:
        """As `Device.apply_zero_offset`: asks for it now, and adds it to clockwise angles. Off by default."""
        self._offset_deg = (yield from self.zero_offset()) if on else 0.0
        return self._offset_deg

    def power_down_protection(self, on: bool) -> Script[bool]:
        """As `Device.power_down_protection`: it can only be toggled, and the response tells the new state.

        The manual (3.8) recommends it if lidar and host have separate power supplies: the lidar then stops when the
        host has lost its supply. Streams started with protection on must be kept alive. Before the first call the
        state is not known, since it cannot be asked for. It is assumed to be off until a stream ends as if it were
        on (`explain_silence`). Without protection, a SCAN in mid-scan is not documented, so none is sent.
        """
        if not self._model.protection:
            return (yield from super().power_down_protection(on))
        for attempt in range(1, MOST_TOGGLES + 1):
            try:
                if (yield from self._toggled(commands.TOGGLE_PROTECTION)) is on:
                    self._wanted_protection = on
                    return on
            except ResponseTimeout:
                # It may have been toggled all the same: toggle again and see.
                if attempt == MOST_TOGGLES:
                    raise
        raise RemoteProtocolError(f"power-down protection does not go {'on' if on else 'off'}")

    def _be_as_set(self) -> Script[None]:
        """Set again what the program has set: no document says what outlasts a restart."""
        if self._was_restarted:
            if self._wanted_speed is not None:
                yield from commands.step_to(self._wanted_speed)
            if self._wanted_protection is not None:
                yield from self.power_down_protection(self._wanted_protection)
            self._was_restarted = False
        if self._protected is None:
            yield from self._learn_protection()

    def _learn_protection(self) -> Script[None]:
        """Find out whether power-down protection is on: two toggles tell it and leave it as it was."""
        told = 0
        for _ in range(MOST_TOGGLES):
            with suppress(ResponseTimeout):
                told += (yield from self._toggled(_LEARN_PROTECTION)) is not None
            if told == 2:
                return

    def _toggled(self, request: Request) -> Script[bool | None]:
        """Toggle once; returns whether protection is on then, None if the device reports an undefined state.

        Until the response comes, the state is not known. A script that is cancelled meanwhile leaves it unknown.
        """
        self._protected = None
        state = (yield request)[0]
        if state <= 1:
            self._protected = state == 0
        return self._protected
