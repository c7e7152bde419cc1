"""What takes several requests: the scan frequency, power-down protection, and the zero-angle offset.

The first is set in steps, the second is toggled: neither can be set to a value. So each step is judged by what the
device says it has reached, and a request whose response was lost is not repeated before that is known (4ROS
development manual, 3.5 and 3.8; the vendor's SDK).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Final

from lidario.errors import RemoteProtocolError, ResponseTimeout
from lidario.families.base import Script
from lidario.families.responses import agreed
from lidario.families.ydlidar import commands
from lidario.wire.envelope import Request

FINE_STEP: Final = 10
COARSE_BEYOND: Final = 95
"""Hundredths of Hz: the small step, and the difference above which a step of 1 Hz is better (SDK)."""
MOST_STEPS: Final = 40
"""7 coarse and 9 fine steps lead from end to end of the range; twice that, since the device may not hear some."""
MOST_TOGGLES: Final = 4
"""Attempts; the SDK makes as many."""
LEARN_TIMEOUT_S: Final = 0.5

_LEARN_PROTECTION: Final = replace(commands.TOGGLE_PROTECTION, timeout=LEARN_TIMEOUT_S)


def ask_speed() -> Script[int]:
    """The scan frequency that is set, in hundredths of Hz."""
    return _hundredths((yield from agreed(commands.GET_SPEED)))


def step_to(wanted: int) -> Script[float]:
    """Step to a scan frequency in hundredths of Hz; returns what was reached, in Hz."""
    current = yield from ask_speed()
    for _ in range(MOST_STEPS):
        gap = wanted - current
        if abs(gap) <= FINE_STEP // 2:
            break
        coarse = abs(gap) > COARSE_BEYOND
        try:
            reached = _hundredths((yield commands.STEPS[coarse, gap > 0]))
        except ResponseTimeout:
            # Done or not, asking for the step again might do it twice.
            reached = yield from ask_speed()
        else:
            if reached == current:
                break  # the device will not go further
        current = reached
    return (yield from ask_speed()) / 100


def toggle_to(wanted: bool, tell: Callable[[bool | None], None]) -> Script[None]:
    """Toggle power-down protection until it is as `wanted`.

    `tell` is called with each state that the device confirms, and with None before each toggle is sent: until the
    response comes, the state is not known. A script that is cancelled there leaves it unknown.

    Raises:
        RemoteProtocolError: It does not get there.
    """
    for attempt in range(1, MOST_TOGGLES + 1):
        try:
            state = yield from _toggled(commands.TOGGLE_PROTECTION, tell)
        except ResponseTimeout:
            # It may have been toggled all the same: toggle again and see.
            if attempt == MOST_TOGGLES:
                raise
        else:
            if state is wanted:
                return
    raise RemoteProtocolError(f"power-down protection does not go {'on' if wanted else 'off'}")


def learn_protection(tell: Callable[[bool | None], None]) -> Script[None]:
    """Find out whether power-down protection is on: two toggles tell it and leave it. `tell` as in `toggle_to`."""
    told = 0
    for _ in range(MOST_TOGGLES):
        with suppress(ResponseTimeout):
            told += (yield from _toggled(_LEARN_PROTECTION, tell)) is not None
        if told == 2:
            return


def _toggled(request: Request, tell: Callable[[bool | None], None]) -> Script[bool | None]:
    """Toggle once; the state that the device tells, None where it tells none that there is."""
    tell(None)
    state = (yield request)[0]
    if state > 1:
        return None
    tell(state == 0)
    return state == 0


def ask_zero_offset(a_degree: int) -> Script[float]:
    """The zero-angle offset in degrees, of which the device counts so many parts.

    Raises:
        RemoteProtocolError: More than 360 degrees.
    """
    (parts,) = struct.unpack("<i", (yield from agreed(commands.GET_ZERO_OFFSET)))
    degrees: float = parts / a_degree
    if abs(degrees) <= 360:
        return degrees
    raise RemoteProtocolError(f"the device reports a zero-angle offset of {degrees:g} degrees")


def _hundredths(payload: bytes) -> int:
    return int.from_bytes(payload, "little")
