"""What can be set in a YDLIDAR: the scan frequency, power-down protection, and the zero-angle offset.

The first is set in steps, the second is toggled: neither can be set to a value. So each step is judged by what the
device says it has reached, and a request whose response was lost is not repeated before that is known (4ROS
development manual, 3.5 and 3.8; the vendor's SDK). Two things differ from what the SDK does:

* Set scan frequency: SDK 1.2.20 takes 0.4 Hz off what models 100 to 102 report, since "the speed reads 0.4 Hz
  high"; so it leaves a device that reports 10.00 Hz and is asked for 10 Hz at 10.4 Hz. That is not imitated:
  the manual knows nothing of it, and what the motor really does can be seen in the scans.
* Zero-angle offset: the manual says neither which way it counts nor whether the stream contains it. The SDK
  adds it to every angle (clockwise degrees). So does `apply_zero_offset`, but only where it is asked for.
"""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import replace
from typing import Final

from lidario.errors import RemoteProtocolError, ResponseTimeout
from lidario.families.base import Device, Script
from lidario.families.scripts import agreed, frequency_within, told
from lidario.families.ydlidar import commands
from lidario.families.ydlidar.models import Model
from lidario.wire.envelope import Request

FINE_STEP: Final = 10
COARSE_BEYOND: Final = 95
"""Hundredths of Hz: the small step, and the difference above which a step of 1 Hz is better (SDK)."""
MOST_STEPS: Final = 40
"""7 coarse and 9 fine steps lead from end to end of the range; twice that, since the device may not hear some."""
MOST_TOGGLES: Final = 4
"""Attempts; the SDK makes as many."""
LEARN_TIMEOUT_S: Final = 0.5
LAPSE_S: Final = (2.5, 4.0)
"""Without a keepalive a stream ends 3 s after its start (manual 3.8). The last packets may be read half a second
later."""

_LEARN_PROTECTION: Final = replace(commands.TOGGLE_PROTECTION, timeout=LEARN_TIMEOUT_S)


class SettableDevice(Device):
    """One YDLIDAR, as far as something can be set in it."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._firmware = (0, 0)
        # None: it was told to change it and has not said that it did.
        self._protected: bool | None = False
        self._offset_deg = 0.0
        # What the program has set, to be set again when the device was restarted.
        self._wanted_protection: bool | None = None
        self._wanted_speed: int | None = None
        self._was_restarted = False

    def restarted(self) -> None:
        # The next start sets speed and protection again, if the program has set them.
        self._was_restarted = True
        self._protected = False

    def explain_silence(self, lasted_s: float) -> Script[bool]:
        """As `Device.explain_silence`: an earlier program may have left power-down protection on.

        It cannot be asked for, only be toggled: two toggles in a row tell it and leave it. They are sent only to a
        device that has stopped when protection would have stopped it, so never without need.
        """
        earliest, latest = LAPSE_S
        if not self._model.protection:
            return False
        if self._protected or (lasted_s and not earliest <= lasted_s <= latest):
            return False
        yield from self._learn_protection()
        return bool(self._protected)

    def scan_frequency_range(self) -> Script[tuple[float, float]]:
        # The data sheet's, since the device cannot be asked.
        if self._model.speeds is None:
            return super().scan_frequency_range()
        return told(self._model.speeds)

    def scan_frequency(self) -> Script[float]:
        """As `Device.scan_frequency`: the frequency that is set, not the one the motor reaches."""
        if self._model.speeds is None:
            return (yield from super().scan_frequency())
        return (yield from _ask_speed()) / 100

    def set_scan_frequency(self, hertz: float) -> Script[float]:
        """As `Device.set_scan_frequency`: in steps of 1 and 0.1 Hz, then read back."""
        if self._model.speeds is None:
            # Its motor follows the supply, or a pin that is not in the cable.
            return super().set_scan_frequency(hertz)
        wanted = frequency_within(hertz, self._model.speeds, self._model.title)
        return self._set_speed(round(wanted * 100))

    def zero_offset(self) -> Script[float]:
        # Clockwise degrees, if it counts the way the SDK takes it.
        if not self._model.offset:
            return (yield from super().zero_offset())
        (parts,) = struct.unpack("<i", (yield from agreed(commands.GET_ZERO_OFFSET)))
        degrees: float = parts / self._model.offset_parts(self._firmware)
        if abs(degrees) <= 360:
            return degrees
        raise RemoteProtocolError(f"the device reports a zero-angle offset of {degrees:g} degrees")

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
                yield from _step_to(self._wanted_speed)
            if self._wanted_protection is not None:
                yield from self.power_down_protection(self._wanted_protection)
            self._was_restarted = False
        if self._protected is None:
            yield from self._learn_protection()

    def _set_speed(self, hundredths: int) -> Script[float]:
        reached = yield from _step_to(hundredths)
        self._wanted_speed = hundredths
        return reached

    def _learn_protection(self) -> Script[None]:
        """Find out whether power-down protection is on: two toggles tell it and leave it."""
        told = 0
        for _ in range(MOST_TOGGLES):
            with suppress(ResponseTimeout):
                told += (yield from self._toggled(_LEARN_PROTECTION)) is not None
            if told == 2:
                return

    def _toggled(self, request: Request) -> Script[bool | None]:
        """Toggle once; whether protection is on then, None where the device tells no state that there is.

        Until the response comes, that is not known. A script that is cancelled there leaves it unknown.
        """
        self._protected = None
        state = (yield request)[0]
        if state <= 1:
            self._protected = state == 0
        return self._protected


def _step_to(wanted: int) -> Script[float]:
    """Step to a scan frequency in hundredths of Hz; returns what was reached, in Hz."""
    current = yield from _ask_speed()
    for _ in range(MOST_STEPS):
        gap = wanted - current
        if abs(gap) <= FINE_STEP // 2:
            break
        coarse = abs(gap) > COARSE_BEYOND
        try:
            reached = _hundredths((yield commands.STEPS[coarse, gap > 0]))
        except ResponseTimeout:
            # Done or not, asking for the step again might do it twice.
            reached = yield from _ask_speed()
        else:
            if reached == current:
                break  # the device will not go further
        current = reached
    return (yield from _ask_speed()) / 100


def _ask_speed() -> Script[int]:
    """The scan frequency that is set, in hundredths of Hz."""
    return _hundredths((yield from agreed(commands.GET_SPEED)))


def _hundredths(payload: bytes) -> int:
    return int.from_bytes(payload, "little")
