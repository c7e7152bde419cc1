"""The measurement packet ``55 AA``: so many samples between two angles, under a folded check value.

Layout (Camsense's ``T2SDK``, and 47 packets of a real X1, all of whose check values hold), little-endian::

    0        55 AA
    2        how samples lie: 03 with 3 bytes, 07 with 4
    3        number of samples n: 8 of an X1, 12 of an LDS08RR
    4        u16     speed of the rotor, 1/64 revolutions a minute
    6        u16     angle of the first sample, A000 + 1/64 degrees
    8        n x     u16 distance in mm, 14 bits; bit 15: none; and quality, 8 or 16 bits
    8 + kn   u16     angle of the last sample, likewise
    10 + kn  u16     check value of fifteen bits over all words before

While the rotor speeds up, packets have the start 0, then A000, and the end the same: they tell no angles, and are
records here.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.two_angles import TwoAngleFormat
from lidario.wire.rows import Check, Fold15

ZERO: Final = 0xA000
FULL_TURN: Final = 360 << 6


def _layout(samples: int, quality: str) -> np.dtype[Any]:
    sample = np.dtype([("distance", "<u2"), ("quality", quality)])
    return np.dtype(
        [
            ("mark", "u1", 4),
            ("speed", "<u2"),
            ("start", "<u2"),
            ("samples", sample, samples),
            ("end", "<u2"),
            ("check", "<u2"),
        ]
    )


class PacketFormat(TwoAngleFormat):
    """The packets of an X1. The types are our own numbers."""

    name = "55 AA"
    response_type = 0x55
    layout: np.dtype[Any] = _layout(8, "u1")
    marks: tuple[bytes, ...] = (b"\x55", b"\xaa", b"\x03", b"\x08")
    check: Check = Fold15(17)
    told_by = 0  # its angles tell whether the rotor is up to speed
    full_turn = FULL_TURN
    zero = ZERO
    an_rpm: float = 64

    def _turns(self, data: bytearray, at: int) -> bool:
        end = at + self.shortest - 4
        return data[at + 7] >= ZERO >> 8 and data[at + 6 : at + 8] != data[end : end + 2]

    def _turning(self, rows: NDArray[Any]) -> NDArray[np.bool_]:
        turning: NDArray[np.bool_] = (rows["start"] >= ZERO) & (rows["start"] != rows["end"])
        return turning


class LongFormat(PacketFormat):
    """The packets of an LDS08RR of this kind."""

    response_type = 0x56
    layout: np.dtype[Any] = _layout(12, "<u2")
    marks: tuple[bytes, ...] = (b"\x55", b"\xaa", b"\x07", b"\x0c")
    check: Check = Fold15(29)
