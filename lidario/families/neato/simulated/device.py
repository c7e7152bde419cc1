"""The device side: packets as long as the rotor turns, text when it boots; it hears nothing.

It measures at whole degrees, an XV-11 counter-clockwise. Somebody else powers its motor: `power_motor`. Below 200
revolutions a minute it sends two packets a revolution, all of whose samples tell error 52, as in the recording of a
real XV-11 whose motor is stopped (Xevel/NXV11).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lidario.families.neato.simulated.packers import pack_packet
from lidario.sim.chassis import Maker, maker
from lidario.sim.talker import PacedByAngle, within

__all__ = ["PROFILES", "Profile", "SimulatedNeato", "describe", "make_simulated"]

Floats = npt.NDArray[np.float64]

_GREETING: Final = (
    b"Piccolo Laser Distance Scanner\r\nCopyright (c) 2009-2011 Neato Robotics, Inc.\r\n"
    b"Loader\tV2.4.13386\r\nCPU\tSimulated\r\nSerial\tSIM00000\r\nRuntime\tV2.4.13386\r\n#"
)
_TOO_SLOW: Final = 0x52
_SLOWEST_RPM: Final = 200.0


@dataclass(frozen=True, slots=True)
class Profile:
    """What kind of device it is.

    Attributes:
        name: Its name in ``sim://`` sources.
        model: Decides what is random.
        back: Whether it turns counter-clockwise.
        reach_mm: Nearest and farthest distance.
        baudrate: Speed of its line.
        hertz: Revolutions a second.
        commands: Whether it hears requests.
        slots: Packets of a revolution.
        follows: Which recording of a real device it follows, for people; empty where there is none.
    """

    name: str
    model: int
    back: bool
    reach_mm: tuple[float, float]
    baudrate: int = 115_200
    hertz: float = 5.0
    commands: bool = False
    slots: int = 90
    follows: str = ""


PROFILES = {
    profile.name: profile
    for profile in (
        Profile("neato-xv11", 11, back=True, reach_mm=(60.0, 6000.0), follows="one of NXV11"),
        Profile("neato-lds02rr", 2, back=False, reach_mm=(150.0, 6000.0)),
        Profile("neato-lds01rr", 1, back=False, reach_mm=(150.0, 9000.0)),
    )
}


class SimulatedNeato(PacedByAngle[Profile]):
    """One simulated device; arguments and attributes as in `Talker`."""

    def _greeting(self) -> bytes:
        return _GREETING

    def _samples(self, rpm: float) -> int:  # noqa: ARG002
        return 4

    def _direction(self, turned: Floats) -> Floats:
        return -turned if self.profile.back else turned

    def _pack(self, slot: int, millimetres: Floats, rpm: float) -> bytes:
        if rpm < _SLOWEST_RPM:
            return pack_packet(slot, [0.0] * 4, [20] * 4, rpm=rpm, code=_TOO_SLOW) if slot % 45 == 0 else b""
        seen = within(millimetres, self.profile.reach_mm)
        # It falls with the square of the distance: 90 at a metre.
        strengths = np.where(seen > 0, np.clip(90e6 / np.maximum(seen, 250.0) ** 2, 4, 1202), 0).astype(int)
        return pack_packet(slot, seen.tolist(), strengths.tolist(), rpm=rpm)


make_simulated: Maker[SimulatedNeato] = maker(SimulatedNeato, PROFILES)
"""Builds a simulated device by the name of its profile, such as ``"neato-xv11"``."""


def describe(model: str) -> str:
    """What a model is, in a few words."""
    profile = PROFILES[model]
    sense = "counter-clockwise" if profile.back else "clockwise"
    follows = f"; like {profile.follows}" if profile.follows else ""
    return f"{profile.baudrate} baud, 1800/s, {sense}; only talks{follows}"
