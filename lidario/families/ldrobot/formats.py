"""The measurement packet ``54 2C``: 47 bytes with twelve samples, the same for all models.

Layout (LD06 development manual v1.0, and the vendor's SDKs), little-endian::

    0   54 2C   mark; the low five bits of 2C are the number of samples (of an LD08 by ROBOTIS's driver also 54 EC)
    2   u16     speed of the rotor, degrees a second
    4   u16     angle of the first sample, 1/100 degrees
    6   12 x    u16 distance in mm, 0 where nothing came back; u8 intensity
    42  u16     angle of the last sample
    44  u16     time in ms, from 0 to 29999 again and again; of an LD08 perhaps to 65535
    46  u8      CRC-8 of all before it: polynomial 4D, begins at 0, not reflected

The mark stands inside packets by chance, and the CRC lets one of 256 such places pass, so a packet that is not due
needs another one behind it. Records that may stand between packets: ``54 E0`` tells of a blocked or covered
window (4 bytes), ``54 0F`` what the device is (23 bytes), ``54 A0`` to ``54 A8`` are responses of the LD14P with
their length in the third byte. Each ends with the same CRC.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.two_angles import TwoAngleFormat
from lidario.wire.events import Packets
from lidario.wire.formats import NO_PACKET, Ticks
from lidario.wire.rows import Check, Crc8

HEAD: Final = 0x54
SIZE: Final = 47
RECORDS: Final = {0xE0: 4, 0x0F: 23}
RESPONSES: Final = range(0xA0, 0xA9)
LONGEST_RESPONSE: Final = 50

SAMPLE: Final = np.dtype([("distance", "<u2"), ("intensity", "u1")])
PACKET: Final = np.dtype(
    [
        ("mark", "u1", 2),
        ("speed", "<u2"),
        ("start", "<u2"),
        ("samples", SAMPLE, 12),
        ("end", "<u2"),
        ("time", "<u2"),
        ("crc", "u1"),
    ]
)
CRC: Final = Crc8(0x4D, SIZE - 1)


class PacketFormat(TwoAngleFormat):
    """The packets of models that measure the time of flight."""

    name = "54 2C"
    response_type = 0x2C
    layout: np.dtype[Any] = PACKET
    marks: tuple[bytes, ...] = (b"\x54", b"\x2c\xec")
    check: Check = CRC
    full_turn = 36_000
    an_rpm: float = 6
    ticks: Ticks | None = Ticks(1_000_000, 30_000)

    @classmethod
    def samples_a_second(cls, packets: bytes) -> float:
        """As `TwoAngleFormat.samples_a_second`; by the times of packets where their rotor does not tell it."""
        rate = super().samples_a_second(packets)
        if rate:
            return rate
        times = np.frombuffer(packets, cls.layout)["time"].astype(np.int32)
        steps = np.diff(times)
        # Between others packets are missing, or the clock begins anew.
        usual = steps[np.abs(steps - np.median(steps)) <= 1]
        took_ms = int(usual.sum())
        return 12e3 * usual.size / took_ms if took_ms > 0 else 0.0

    def stamps(self, packets: Packets) -> NDArray[np.int64]:
        return np.frombuffer(packets.data, PACKET)["time"].astype(np.int64)

    def other_record(self, data: bytearray, at: int) -> int:
        begin = data[at : at + 3]
        if begin[0] != HEAD:
            return NO_PACKET
        if len(begin) < 2:
            return 0
        size = RECORDS.get(begin[1], NO_PACKET)
        if begin[1] in RESPONSES:
            if len(begin) < 3:
                return 0
            size = begin[2] + 4 if begin[2] <= LONGEST_RESPONSE else NO_PACKET
        if size == NO_PACKET or len(data) - at < size:
            return min(size, 0)
        return NO_PACKET if CRC.of(data[at : at + size]) else size


class TriangleFormat(PacketFormat):
    """The same packets, of an LD14 or LD14P: their angles are corrected. The type is our own number."""

    response_type = 0x2D


class AxisFormat(PacketFormat):
    """The same packets, of an LD08: angles and distances are corrected. The type is our own number."""

    response_type = 0x2E
    # No document tells whether its time begins anew at 30000 or at 65536 (more_families_2.md 1.8).
    ticks: Ticks | None = None
