"""The measurement packet ``FA A0`` to ``FA F9``: 22 bytes with four samples, 90 of them in a revolution.

Layout of firmware 2.4 and later (XV-11 hacking wiki; held by each of 11451 packets of a recording), little-endian::

    0   FA
    1   u8      A0 + number of the packet, 0 to 89: its first sample stands at 4 times as many degrees
    2   u16     speed of the rotor, 1/64 revolutions a minute
    4   4 x     u16 distance in mm, 14 bits; bit 15: none, the low byte says why; bit 14: a weak return
                u16 strength of the return
    20  u16     check value of fifteen bits over the ten words before

Below 200 revolutions a minute the device does not measure: it sends two packets a revolution, half of one apart, of
which all samples say so (error 52). They are records here, and no lost packets of a healthy stream. Text that a
boot prints stands before the packets.

A sample stands at a whole degree, counted in the sense in which the rotor turns: counter-clockwise in an XV-11 (the
viewer in Xevel/NXV11 plots it so), clockwise in the others. Weak returns are delivered: in the recording their
distances are as plausible as those of others, at a fifth of the strength. Strengths are divided by 8, so that 2040
is the largest one that is told; 1202 is the largest one in the recording.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.slots import DegreeFormat
from lidario.wire.rows import Check, Fold15

SLOWEST: Final = 200 * 64  # the speed below which nothing is measured, as packets state it

_NONE: Final = 0x8000
_MILLIMETRES: Final = 0x3FFF
SAMPLE: Final = np.dtype([("distance", "<u2"), ("strength", "<u2")])


class PacketFormat(DegreeFormat):
    """The packets of an LDS01RR or LDS02RR, which turn clockwise. The types are our own numbers."""

    name = "FA A0"
    response_type = 0x16
    layout: np.dtype[Any] = np.dtype(
        [("mark", "u1"), ("number", "u1"), ("speed", "<u2"), ("samples", SAMPLE, 4), ("check", "<u2")]
    )
    marks: tuple[bytes, ...] = (b"\xfa", bytes(range(0xA0, 0xFA)))
    check: Check = Fold15(10)
    told_by = 4
    an_rpm: float = 64
    slowest: int = SLOWEST  # the speed below which packets are records

    @classmethod
    def returns_of(cls, rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        words = rows["samples"]["distance"]
        strength = np.minimum(rows["samples"]["strength"] >> 3, 255)
        return np.where(words & _NONE, 0, words & _MILLIMETRES), strength

    def _turns(self, data: bytearray, at: int) -> bool:
        # The low byte of that limit is 0: the high byte tells.
        return data[at + 3] >= self.slowest >> 8

    def _turning(self, rows: NDArray[Any]) -> NDArray[np.bool_]:
        turning: NDArray[np.bool_] = rows["speed"] >= self.slowest
        return turning


class BackFormat(PacketFormat):
    """The same packets, of an XV-11: it turns counter-clockwise."""

    response_type = 0x17
    field_deg: float = -360.0


class AnySpeed(PacketFormat):
    """The same packets, also those that are records there: what tells that the rotor is too slow."""

    slowest: int = 0
