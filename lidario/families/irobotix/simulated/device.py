"""The device side: frames as long as the rotor turns; it hears nothing.

It takes its samples at equal times and sends those of one sixteenth or fifteenth of a revolution together, so how
many they are follows from the speed. Somebody else powers its motor: `power_motor`. Below four revolutions a second
and above ten it sends only that it fails, and how fast it turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lidario.families.irobotix.simulated.packers import pack_failure, pack_measurement
from lidario.sim.chassis import Maker, maker
from lidario.sim.talker import PacedByAngle, within

__all__ = ["PROFILES", "Profile", "SimulatedIrobotix", "describe", "make_simulated"]

Floats = npt.NDArray[np.float64]

_SPEEDS = (240.0, 600.0)
_MOST = 80


@dataclass(frozen=True, slots=True)
class Profile:
    """What kind of device it is.

    Attributes:
        name: Its name in ``sim://`` sources.
        model: Decides what is random.
        rate: Samples a second.
        slots: Frames of a revolution.
        hertz: Revolutions a second.
        baudrate: Speed of its line.
        tells_end: Whether frames have the angle of their last sample, and version 10.
        reach_mm: Nearest and farthest distance.
        commands: Whether it hears requests.
    """

    name: str
    model: int
    rate: float
    slots: int = 16
    hertz: float = 6.0
    baudrate: int = 230_400
    tells_end: bool = False
    reach_mm: tuple[float, float] = (150.0, 8000.0)
    commands: bool = False


PROFILES = {
    profile.name: profile
    for profile in (
        Profile("irobotix-delta2a", 1, 5000.0),
        Profile("irobotix-delta2b", 2, 5000.0),
        Profile("irobotix-delta2d", 3, 2000.0, baudrate=115_200, tells_end=True),
        Profile("irobotix-delta2g", 4, 1890.0, slots=15, hertz=5.25, baudrate=115_200),
        Profile("irobotix-lds08rr", 5, 1890.0, slots=15, hertz=5.25, baudrate=115_200),
    )
}


class SimulatedIrobotix(PacedByAngle[Profile]):
    """One simulated device; arguments and attributes as in `Talker`."""

    def _samples(self, rpm: float) -> int:
        return int(np.clip(round(self.profile.rate * 60 / (max(rpm, 60.0) * self.profile.slots)), 1, _MOST))

    def _pack(self, slot: int, millimetres: Floats, rpm: float) -> bytes:
        if not _SPEEDS[0] <= rpm <= _SPEEDS[1]:
            return pack_failure(rpm / 60)
        seen = within(millimetres, self.profile.reach_mm)
        signals = np.where(seen > 0, np.clip(130 - seen / 100, 20, 130), 0).astype(int)
        start = 36_000 * slot // self.profile.slots
        last = start + 36_000 * (len(seen) - 1) // (self.profile.slots * len(seen))
        more = {"end": last, "version": 0x10} if self.profile.tells_end else {}
        return pack_measurement(start, seen.tolist(), signals.tolist(), hertz=rpm / 60, **more)


make_simulated: Maker[SimulatedIrobotix] = maker(SimulatedIrobotix, PROFILES)
"""Builds a simulated device by the name of its profile, such as ``"irobotix-delta2a"``."""


def describe(model: str) -> str:
    """What a model is, in a few words."""
    profile = PROFILES[model]
    return f"{profile.baudrate} baud, {profile.rate:.0f}/s; only talks"
