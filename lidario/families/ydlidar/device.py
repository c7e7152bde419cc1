"""One YDLIDAR 4ROS: what its responses mean, and how it is started and set.

Payloads: 4ROS development manual, figures 10, 12 and 13 to 15. Where it contradicts what is seen elsewhere:

* Firmware: the manual's two bytes read as minor, major here, although it names the first one major. The SDK
  reads them so, and so do logs of its users and an independent driver.
* Health: the manual asks by A5 91, the SDK by A5 92. The manual's is tried first, then the other one.
* Set scan frequency: SDK 1.2.20 takes 0.4 Hz off what models 100 to 102 report, since "the speed reads 0.4 Hz
  high"; so it leaves a device that reports 10.00 Hz and is asked for 10 Hz at 10.4 Hz. That is not imitated:
  the manual knows nothing of it, and what the motor really does can be seen in the scans.
* Zero-angle offset: the manual says neither which way it counts nor whether the stream contains it. The SDK
  adds it to every angle (clockwise degrees). So does `apply_zero_offset`, but only where it is asked for.
* "Old" firmware (1.2 and below): the SDK halves all distances of models 100 to 102 then. It is not done here:
  the manual knows only whole millimetres, and a version read in the wrong order would halve every distance.

The motor has neither a pin nor a request of its own: a scan starts it, STOP stops it.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Final

from lidario.errors import InvalidValue, RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.arguments import finite
from lidario.families.base import Device, Keepalive, Script, Stream, agreed, health_of
from lidario.families.ydlidar import commands
from lidario.families.ydlidar.decode import PointCloudDecoder
from lidario.families.ydlidar.formats import PointCloud
from lidario.model import DeviceInfo, Health, ScanMode
from lidario.wire.envelope import Request

__all__ = ["Device4Ros"]

MODELS: Final = {100: "TG15", 101: "4ROS", 102: "TG50"}
"""Models that send this stream (vendor SDK). The code of the 4ROS (manual 3.3) is the TG30's in the SDK."""
MODE: Final = ScanMode(
    id=0,
    name="Standard",
    sample_us=50.0,
    max_distance=30.0,
    response_type=PointCloud.response_type,
    typical=True,
)
"""The only mode: 20000 samples a second, up to 30 m (data sheet)."""
SPEED_RANGE: Final = (5.0, 12.0)
"""Hz (data sheet)."""
FINE_STEP: Final = 10
COARSE_BEYOND: Final = 95
"""Hundredths of Hz: the small step, and the difference above which a step of 1 Hz is better (SDK)."""
MOST_STEPS: Final = 40
"""7 coarse and 9 fine steps lead from end to end of the range; twice that, since the device may not hear some."""
MOST_TOGGLES: Final = 4
"""Attempts; the SDK makes as many."""
OFFSETS_A_TURN: Final = 4 * 360
SPIN_UP_S: Final = 4.0
"""No document says how long the motor takes; 2.5 s are assumed, and a margin added."""
SLOWEST_TURN_S: Final = 0.5
"""One revolution at the lowest speed that a start packet can tell, 3 Hz, and half as long again."""
KEEPALIVE_S: Final = 0.4
"""The manual demands less than 3 s; the SDK repeats every second. A program that blocks its event loop for 2.5 s
may begin to do so just before the next one is due, and must not stop the device by that."""
LAPSE_S: Final = (2.5, 4.0)
"""Without a keepalive a stream ends 3 s after its start (manual 3.8). The last packets may be read half a second
later."""
LEARN_TIMEOUT_S: Final = 0.5


class Device4Ros(Device):
    """A 4ROS, or one of the TG models that speak the same way."""

    can_keep_spinning = False

    def __init__(self) -> None:
        self._model: int | None = None
        self._health_request: Request | None = None
        self._protected = False
        self._offset_deg = 0.0
        # What the program has set, to be set again when the device was restarted.
        self._wanted_protection: bool | None = None
        self._wanted_speed: int | None = None
        self._was_restarted = False

    def scan_frequency_range(self) -> Script[tuple[float, float]]:
        """As `Device.scan_frequency_range`: the data sheet's, since the device cannot be asked."""
        yield from ()
        return SPEED_RANGE

    def stop(self) -> Request:
        """As `Device.stop`; the motor stops too."""
        return commands.STOP

    def halt(self) -> tuple[Request, ...]:
        """As `Device.halt`: the forced stop that the SDK sends before each STOP, then the manual's STOP."""
        return (commands.FORCED_STOP, commands.STOP)

    def reset(self) -> Request:
        """As `Device.reset`. Whether settings outlast it is not documented."""
        return commands.RESET

    def restarted(self) -> None:
        """As `Device.restarted`: the next start sets speed and protection again, if the program has set them."""
        self._was_restarted = True
        self._protected = False

    def explain_silence(self, lasted_s: float) -> Script[bool]:
        """As `Device.explain_silence`: an earlier program may have left power-down protection on.

        It cannot be asked for, only be toggled: two toggles in a row tell it and leave it. They are sent only to a
        device that has stopped when protection would have stopped it, so never without need.
        """
        earliest, latest = LAPSE_S
        if self._protected or (lasted_s and not earliest <= lasted_s <= latest):
            return False
        told = 0
        for _ in range(MOST_TOGGLES):
            try:
                state = (yield _LEARN_PROTECTION)[0]
            except ResponseTimeout:
                continue
            if state <= 1:
                self._protected = state == 0
                told += 1
                if told == 2:
                    break
        return self._protected

    def identify(self) -> Script[DeviceInfo]:
        """As `Device.identify`; asked until two responses are equal."""
        model, minor, major, hardware, serial = struct.unpack("<BBBB16s", (yield from agreed(commands.GET_INFO)))
        self._model = model
        return DeviceInfo(
            family="ydlidar",
            model=_model_name(model),
            model_id=model,
            firmware=f"{major}.{minor}",
            hardware=hardware,
            serial="".join(str(digit) if digit < 10 else f"[{digit:02x}]" for digit in serial),
        )

    def complete_probe(self) -> bytes:
        """As `Device.complete_probe`."""
        return commands.COMPLETE_INFO

    def health(self) -> Script[Health]:
        """As `Device.health`; a status that is not defined is a warning."""
        status, code = struct.unpack("<BH", (yield from self._ask_health()))
        return health_of(status, code)

    def modes(self) -> Script[tuple[ScanMode, ...]]:
        """As `Device.modes`: there is one, and the device cannot be asked."""
        yield from ()
        return (MODE,)

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        """As `Device.start`.

        Raises:
            Unsupported: A forced scan, which the manual does not know; another device's mode; or a model
                that measures in another unit.
        """
        if force:
            raise Unsupported("a scan of this device cannot be forced")
        if self._model is not None and self._model not in MODELS:
            raise Unsupported(
                f"model {self._model} measures in other units than a 4ROS; lidario decodes models "
                + ", ".join(f"{code} ({name})" for code, name in MODELS.items())
            )
        if mode.response_type != MODE.response_type or mode.id != MODE.id:
            raise Unsupported(f"this device has one scan mode, {MODE.name!r}, and not {mode.name!r}")
        if self._was_restarted:
            yield from self._restore()
        try:
            stream = PointCloud()
            yield commands.scan(stream)
        except ResponseTimeout:
            # A header that was lost is not repeated while packets flow: begin again from standstill.
            yield commands.STOP
            stream = PointCloud()
            yield commands.scan(stream)
        return Stream(
            format=stream,
            decoder=PointCloudDecoder(),
            mode=mode,
            sample_ns=MODE.sample_us * 1e3,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=SLOWEST_TURN_S,
            keepalive=Keepalive(commands.KEEPALIVE, KEEPALIVE_S) if self._protected else None,
            zero_offset_deg=self._offset_deg,
        )

    def scan_frequency(self) -> Script[float]:
        """As `Device.scan_frequency`: the frequency that is set, not the one the motor reaches."""
        return (yield from self._ask_speed()) / 100

    def set_scan_frequency(self, hertz: float) -> Script[float]:
        """As `Device.set_scan_frequency`: in steps of 1 and 0.1 Hz, then read back.

        Raises:
            InvalidValue: Not a finite number, or outside of 5 to 12 Hz.
        """
        lowest, highest = SPEED_RANGE
        wanted = finite(hertz, "a scan frequency")
        if not lowest <= wanted <= highest:
            raise InvalidValue(f"{wanted:g} Hz is outside of the 4ROS's {lowest:g} to {highest:g} Hz")
        return self._set_speed(round(wanted * 100))

    def zero_offset(self) -> Script[float]:
        """As `Device.zero_offset`: clockwise degrees, if it counts the way the SDK takes it.

        Raises:
            RemoteProtocolError: More than 360 degrees, twice.
        """
        quarters = 0
        for _ in range(2):
            (quarters,) = struct.unpack("<i", (yield commands.GET_ZERO_OFFSET))
            if abs(quarters) <= OFFSETS_A_TURN:
                return float(quarters) / 4
        raise RemoteProtocolError(f"the device reports a zero-angle offset of {quarters / 4:g} degrees")

    def apply_zero_offset(self, on: bool) -> Script[float]:
        """As `Device.apply_zero_offset`: asks for it now, to be added to clockwise angles. Off at first."""
        self._offset_deg = (yield from self.zero_offset()) if on else 0.0
        return self._offset_deg

    def power_down_protection(self, on: bool) -> Script[bool]:
        """As `Device.power_down_protection`: it can only be toggled, and the response tells the new state.

        The manual (3.8) recommends it where lidar and host have separate power supplies, so that the lidar stops
        when the host has lost its own. Streams started with protection on must be kept alive. Before this was
        called the state is not known, since it cannot be asked for; it is assumed to be off until a stream ends as
        if it were on (`explain_silence`). Without protection a SCAN in mid-scan is not documented, so none is sent.

        Raises:
            RemoteProtocolError: The device does not reach the wanted state.
        """
        wanted = bool(on)  # 1 and numpy's True are meant as well, and are not identical to True
        for attempt in range(MOST_TOGGLES):
            try:
                state = (yield commands.TOGGLE_PROTECTION)[0]
            except ResponseTimeout:
                # It may have been toggled all the same: toggle again and see.
                if attempt == MOST_TOGGLES - 1:
                    raise
                continue
            if state <= 1:
                self._protected = state == 0
                if self._protected == wanted:
                    self._wanted_protection = wanted
                    return wanted
        raise RemoteProtocolError(f"power-down protection does not go {'on' if wanted else 'off'}")

    def _restore(self) -> Script[None]:
        """Set again what the program has set: no document says what outlasts a restart."""
        if self._wanted_speed is not None:
            yield from self._step_to(self._wanted_speed)
        if self._wanted_protection is not None:
            yield from self.power_down_protection(self._wanted_protection)
        self._was_restarted = False

    def _set_speed(self, hundredths: int) -> Script[float]:
        reached = yield from self._step_to(hundredths)
        self._wanted_speed = hundredths
        return reached

    def _ask_health(self) -> Script[bytes]:
        known = self._health_request
        *questions, last = ((known,) if known else (commands.GET_HEALTH, commands.GET_HEALTH_92)) * 2
        self._health_request = None
        for request in questions:
            try:
                payload = yield request
            except ResponseTimeout:
                continue
            self._health_request = request
            return payload
        payload = yield last
        self._health_request = last
        return payload

    def _ask_speed(self) -> Script[int]:
        return _hundredths((yield commands.GET_SPEED))

    def _step_to(self, wanted: int) -> Script[float]:
        current = yield from self._ask_speed()
        for _ in range(MOST_STEPS):
            gap = wanted - current
            if abs(gap) <= FINE_STEP // 2:
                break
            coarse = abs(gap) > COARSE_BEYOND
            try:
                reached = _hundredths((yield _STEPS[coarse, gap > 0]))
            except ResponseTimeout:
                # Done or not, asking for the step again might do it twice.
                reached = yield from self._ask_speed()
            else:
                if reached == current:
                    break  # the device will not go further
            current = reached
        return (yield from self._ask_speed()) / 100


_LEARN_PROTECTION: Final = replace(commands.TOGGLE_PROTECTION, timeout=LEARN_TIMEOUT_S)
_STEPS: Final = {
    (True, True): commands.SPEED_UP_BY_1,
    (True, False): commands.SPEED_DOWN_BY_1,
    (False, True): commands.SPEED_UP_BY_01,
    (False, False): commands.SPEED_DOWN_BY_01,
}


def _hundredths(payload: bytes) -> int:
    return int.from_bytes(payload, "little")


def _model_name(model: int) -> str:
    name = MODELS.get(model)
    return f"YDLIDAR {name}" if name else f"YDLIDAR (model {model})"
