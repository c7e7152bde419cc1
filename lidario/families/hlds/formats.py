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
as one without a check value, and what it sends tells whether one of the two holds (`device`).
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.slots import FIRST, HEAD, DegreeFormat, DegreePacket
from lidario.wire.rows import Fold15

__all__ = ["PACKET", "SIZE", "CheckedFormat", "PacketFormat", "checked"]

PACKETS: Final = 60
SIZE: Final = 42
SAMPLES: Final = 6
FOLD: Final = Fold15(20)
CHECKED: Final = 40
"""Bytes before the check value."""

SAMPLE: Final = np.dtype([("intensity", "<u2"), ("distance", "<u2"), ("reserved", "<u2")])
LAYOUT: Final = np.dtype(
    [("mark", "u1"), ("number", "u1"), ("speed", "<u2"), ("samples", SAMPLE, SAMPLES), ("check", "u1", 2)]
)
PACKET: Final = DegreePacket(LAYOUT, SAMPLES, 10)


class PacketFormat(DegreeFormat):
    """Packets that are believed when the next one follows where it must. The types are our own numbers."""

    name = "FA A0, 42 bytes"
    response_type = 0x42
    header: re.Pattern[bytes] = re.compile(rb"\xfa[\xa0-\xdb]", re.DOTALL)
    shortest = SIZE
    longest = SIZE
    samples = SAMPLES
    packet = PACKET

    def measure(self, data: bytearray, at: int) -> int:
        """As `StreamFormat.measure`: known when the beginning of the next packet is there."""
        return self._begun(data, at, SIZE + 2)

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        return data[at + size] == HEAD and data[at + size + 1] - FIRST == (data[at + 1] - FIRST + 1) % PACKETS

    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        rows = np.frombuffer(data, LAYOUT, count, at)
        begun, number = self._marked(rows), rows["number"].astype(np.int32) - FIRST
        intact = np.zeros(count, np.bool_)
        intact[:-1] = begun[:-1] & begun[1:] & (number[1:] == (number[:-1] + 1) % PACKETS)
        # Of the last one the next may not be there yet.
        last = at + (count - 1) * SIZE
        intact[-1] = len(data) - last >= SIZE + 2 and begun[-1] and self.intact(data, last, SIZE)
        return intact


class CheckedFormat(PacketFormat):
    """The same packets, of a device of which one of the two check values holds."""

    response_type = 0x43

    def measure(self, data: bytearray, at: int) -> int:
        return self._begun(data, at)

    def intact(self, data: bytearray, at: int, size: int) -> bool:  # noqa: ARG002
        value = 0xFF - (sum(data[at : at + CHECKED]) & 0xFF)
        return data[at + CHECKED] == data[at + CHECKED + 1] == value or FOLD.holds(data, at)

    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        raw = np.frombuffer(data, np.uint8, count * SIZE, at)
        return checked(raw.reshape(count, SIZE)) & self._marked(raw.view(LAYOUT))


def checked(rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Of which packets one of the two check values holds; `rows` has the shape (n, 42)."""
    value = 0xFF - (rows[:, :CHECKED].sum(axis=1, dtype=np.uint32) & 0xFF)
    twice: NDArray[np.bool_] = (rows[:, CHECKED] == value) & (rows[:, CHECKED + 1] == value)
    return twice | FOLD.of_rows(rows)
