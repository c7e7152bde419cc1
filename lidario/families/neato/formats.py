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
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.slots import DegreeFormat, DegreePacket
from lidario.wire.formats import NO_PACKET
from lidario.wire.rows import Fold15

__all__ = ["PACKET", "SIZE", "SLOWEST", "AnySpeed", "BackFormat", "PacketFormat"]

SIZE: Final = 22
SAMPLES: Final = 4
SLOWEST: Final = 200 * 64
"""The speed below which nothing is measured, as packets state it."""
CHECK: Final = Fold15(10)

SAMPLE: Final = np.dtype([("distance", "<u2"), ("strength", "<u2")])
LAYOUT: Final = np.dtype(
    [("mark", "u1"), ("number", "u1"), ("speed", "<u2"), ("samples", SAMPLE, SAMPLES), ("check", "<u2")]
)
PACKET: Final = DegreePacket(LAYOUT, SAMPLES, 64)


class PacketFormat(DegreeFormat):
    """The packets of an LDS01RR or LDS02RR, which turn clockwise. The types are our own numbers."""

    name = "FA A0"
    response_type = 0x16
    header: re.Pattern[bytes] = re.compile(rb"\xfa[\xa0-\xf9]", re.DOTALL)
    shortest = SIZE
    longest = SIZE
    samples = SAMPLES
    packet = PACKET

    def measure(self, data: bytearray, at: int) -> int:
        size = self._begun(data, at, 4)
        return size if size <= 0 or not _is_slow(data, at) else NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:  # noqa: ARG002
        return CHECK.holds(data, at)

    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        raw = np.frombuffer(data, np.uint8, count * SIZE, at)
        rows = raw.view(LAYOUT)
        intact: NDArray[np.bool_] = rows["speed"] >= SLOWEST
        return intact & self._marked(rows) & CHECK.of_rows(raw.reshape(count, SIZE))

    def other_record(self, data: bytearray, at: int) -> int:
        """As `StreamFormat.other_record`: a packet of a rotor that is too slow."""
        size = self._begun(data, at, SIZE)
        if size <= 0:
            return size
        return SIZE if _is_slow(data, at) and CHECK.holds(data, at) else NO_PACKET


class BackFormat(PacketFormat):
    """The same packets, of an XV-11: it turns counter-clockwise."""

    response_type = 0x17
    field_deg: float = -360.0


class AnySpeed(PacketFormat):
    """The same packets, also those that are records there: what tells that the rotor is too slow."""

    def measure(self, data: bytearray, at: int) -> int:
        return self._begun(data, at)


def _is_slow(data: bytearray, at: int) -> bool:
    # The low byte of that limit is 0: the high byte tells.
    return data[at + 3] < SLOWEST >> 8
