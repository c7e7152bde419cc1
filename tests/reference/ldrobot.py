"""Scalar reference decoder for the packets of the LDROBOT lidars.

Angles are device angles: degrees, clockwise, at full precision; the vendor's own decoder divides a packet's span in
whole hundredths. Only clean streams are understood: `split` raises `ValueError` at anything that is neither a
packet with its check value nor one of the two known records, which it leaves out.
"""

import math
import struct
from collections.abc import Sequence
from typing import Literal

from tests.reference.samples import Sample, u16

PACKET_BYTES = 47
SAMPLES = 12
RECORD_BYTES = {0xE0: 4, 0x0F: 23}


def crc8(data: bytes) -> int:
    """CRC-8, polynomial 0x4D, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ (0x4D if value & 0x80 else 0)) & 0xFF
    return value


def split(raw: bytes) -> list[bytes]:
    """Cut a clean stream into packets."""
    packets: list[bytes] = []
    offset = 0
    while offset < len(raw):
        if raw[offset] != 0x54:
            raise ValueError(f"nothing begins at byte {offset}")
        size = RECORD_BYTES.get(raw[offset + 1], PACKET_BYTES)
        piece = raw[offset : offset + size]
        if len(piece) < size or crc8(piece[:-1]) != piece[-1]:
            raise ValueError(f"byte {offset}: wrong check value")
        if size == PACKET_BYTES:
            if piece[1] not in (0x2C, 0xEC):
                raise ValueError(f"byte {offset}: no packet")
            packets.append(piece)
        offset += size
    return packets


def shift_deg(distance_mm: float) -> float:
    """How far the target lies before the beam of an LD14."""
    return math.degrees(math.atan((0.11923 * distance_mm - 18.975571) / (distance_mm + 5.9)))


def from_axis(distance_mm: float) -> tuple[float, float]:
    """Of an LD08: how far the target is from the axis, and by how many degrees it lies before the beam."""
    x, y = distance_mm + 5.9, 0.11923 * distance_mm - 20.14
    # In the single precision that distances are told in.
    (away,) = struct.unpack("<f", struct.pack("<f", math.sqrt(x * x + y * y)))
    return away, math.degrees(math.atan(y / x))


def decode(packets: Sequence[bytes], *, lens: Literal["", "ld08", "ld14"] = "") -> list[Sample]:
    """Decode packets; `lens` names a model that triangulates."""
    samples: list[Sample] = []
    shift = 0.0
    for number, packet in enumerate(packets):
        first = u16(packet, 4) % 36000
        way = (u16(packet, 42) - first) % 36000
        for index in range(SAMPLES):
            raw_deg = (first * 11 + way * index) / 1100
            distance_mm = float(u16(packet, 6 + 3 * index))
            if lens == "ld14" and distance_mm:
                shift = shift_deg(distance_mm)
            elif lens == "ld08":
                distance_mm, shift = from_axis(distance_mm) if distance_mm else (0.0, 0.0)
            angle_deg = (raw_deg - shift) % 360.0
            samples.append(Sample(number, index, raw_deg, angle_deg, distance_mm, packet[8 + 3 * index]))
    return samples
