"""The device side: packets as long as the rotor turns, text when it boots; it hears nothing.

It measures at whole degrees, an XV-11 counter-clockwise. Somebody else powers its motor: `power_motor`. Below 200
revolutions a minute it sends two packets a revolution, all of whose samples tell error 52, as in the recording of a
real XV-11 whose motor is stopped (Xevel/NXV11).

Packets: firmware 2.4 of the XV-11, as its hacking wiki has it.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from lidario.sim.chassis import Maker, by_name, maker
from lidario.sim.talker import Floats, PacedByAngle, TalkerProfile, folded

_NOTHING = 0x8035  # no return: bit 15, and the code that is the most frequent one in the recording
_GREETING: Final = (
    b"Piccolo Laser Distance Scanner\r\nCopyright (c) 2009-2011 Neato Robotics, Inc.\r\n"
    b"Loader\tV2.4.13386\r\nCPU\tSimulated\r\nSerial\tSIM00000\r\nRuntime\tV2.4.13386\r\n#"
)
_TOO_SLOW: Final = 0x52
_SLOWEST_RPM: Final = 200.0


_XV11: Final = TalkerProfile(
    "neato-xv11",
    11,
    slots=90,
    samples=4,
    reach_mm=(60.0, 6000.0),
    note=", counter-clockwise",
    follows="one of NXV11",
    back=True,
    early=True,
)
_LDS02RR: Final = TalkerProfile(
    "neato-lds02rr", 2, slots=90, samples=4, reach_mm=(150.0, 6000.0), note=", clockwise", early=True
)
_LDS01RR: Final = replace(_LDS02RR, name="neato-lds01rr", model=1, reach_mm=(150.0, 9000.0))
PROFILES = by_name(_XV11, _LDS02RR, _LDS01RR)


class SimulatedNeato(PacedByAngle[TalkerProfile]):
    """One simulated device; arguments and attributes as in `Talker`."""

    def _greeting(self) -> bytes:
        return _GREETING

    def _pack(self, slot: int, seen: Floats, rpm: float) -> bytes:
        if rpm < _SLOWEST_RPM:
            return pack_packet(slot, [0.0] * 4, [20] * 4, rpm=rpm, code=_TOO_SLOW) if slot % 45 == 0 else b""
        # It falls with the square of the distance: 90 at a metre.
        strengths = np.where(seen > 0, np.clip(90e6 / np.maximum(seen, 250.0) ** 2, 4, 1202), 0).astype(int)
        return pack_packet(slot, seen.tolist(), strengths.tolist(), rpm=rpm)


make_simulated: Maker[SimulatedNeato] = maker(SimulatedNeato, PROFILES)


def pack_packet(
    index: int, millimetres: Sequence[float], strengths: Sequence[int], *, rpm: float = 300.0, code: int = 0
) -> bytes:
    """Pack one measurement packet of four samples; where `code` is not 0, it is the error that all of them tell.

    0 mm is no return, as is what 14 bits cannot hold.
    """
    body = bytes((0xFA, 0xA0 + index)) + round(rpm * 64).to_bytes(2, "little")
    for distance, strength in zip(millimetres, strengths, strict=True):
        whole = round(float(distance))
        word = 0x8000 | code if code else whole if 0 < whole < 0x4000 else _NOTHING
        body += word.to_bytes(2, "little") + int(strength).to_bytes(2, "little")
    return body + folded(body)
