"""The measurement packet ``FA A0`` to ``FA DB``: 42 bytes with six samples, 60 of them in a revolution.

Layout (ROBOTIS' driver ``hls_lfcd_lds_driver``, ``hlds_laser_publisher.cpp``), little-endian::

    0   FA
    1   u8      A0 + number of the packet, 0 to 59: its first sample stands at 6 times as many degrees
    2   u16     speed of the rotor, 1/10 revolutions a minute
    4   6 x     u16 intensity; u16 distance in mm, 0 where nothing came back; u16 reserved
    40  2 bytes a check value, of which no document is public

The driver checks the first two bytes and nothing else. A user of the vendor's specification takes a packet whose
last two bytes are equal (Jatin1o1/LDS-01-Lidar-Python): a sum of bytes, sent twice; that it is FF less the sum is a
guess. Community ports take the check value of the XV-11 and were never run with a device. So a device is first read
as one without a check value, and what it sends tells whether one of the two holds.

The driver stores sample k at 359 - k degrees counter-clockwise, so the device counts clockwise; exactly mirrored it
would be 360 - k, which is what is given here. Intensities have no documented scale; they are divided by 32, so that
8160 is the largest one that is told.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.slots import FIRST, HEAD, DegreeFormat
from lidario.wire.rows import Check, Fold15

PACKETS: Final = 60
SIZE: Final = 42
CHECKED: Final = 40  # bytes before the check value

SAMPLE: Final = np.dtype([("intensity", "<u2"), ("distance", "<u2"), ("reserved", "<u2")])


class EitherCheck:
    """Either of the two check values."""

    def __init__(self) -> None:
        self._fold = Fold15(CHECKED // 2)

    def holds(self, data: bytearray, at: int) -> bool:
        value = 0xFF - (sum(data[at : at + CHECKED]) & 0xFF)
        return data[at + CHECKED] == data[at + CHECKED + 1] == value or self._fold.holds(data, at)

    def of_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        value = 0xFF - (rows[:, :CHECKED].sum(axis=1, dtype=np.uint32) & 0xFF)
        twice: NDArray[np.bool_] = (rows[:, CHECKED] == value) & (rows[:, CHECKED + 1] == value)
        return twice | self._fold.of_rows(rows)


class CheckedFormat(DegreeFormat):
    """Packets of a device of which one of the two check values holds. The types are our own numbers."""

    name = "FA A0, 42 bytes"
    response_type = 0x43
    layout: np.dtype[Any] = np.dtype(
        [("mark", "u1"), ("number", "u1"), ("speed", "<u2"), ("samples", SAMPLE, 6), ("check", "u1", 2)]
    )
    marks: tuple[bytes, ...] = (b"\xfa", bytes(range(0xA0, 0xDC)))
    check: Check = EitherCheck()
    an_rpm: float = 10

    @classmethod
    def returns_of(cls, rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        samples = rows["samples"]
        return samples["distance"], np.minimum(samples["intensity"] >> 5, 255)


class PacketFormat(CheckedFormat):
    """The same packets, which are believed when the next one follows where it must."""

    response_type = 0x42
    told_by = SIZE + 2  # known when the beginning of the next packet is there

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        return data[at + size] == HEAD and data[at + size + 1] - FIRST == (data[at + 1] - FIRST + 1) % PACKETS

    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        raw = np.frombuffer(data, np.uint8, count * SIZE, at).reshape(count, SIZE)
        begun, number = self._begin(raw), raw[:, 1].astype(np.int32) - FIRST
        intact = np.zeros(count, np.bool_)
        intact[:-1] = begun[:-1] & begun[1:] & (number[1:] == (number[:-1] + 1) % PACKETS)
        # Of the last one the next may not be there yet. It begins as it must where the one before is intact.
        last = at + (count - 1) * SIZE
        intact[-1] = len(data) - last >= SIZE + 2 and self.intact(data, last, SIZE)
        return intact
