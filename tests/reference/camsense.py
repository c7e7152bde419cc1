"""Scalar reference decoder for the packets of a Camsense X1, written from the vendor's SDK alone.

Angles are device angles: degrees, clockwise. Only clean streams of an X1 are understood.
"""

import math
import struct
from collections.abc import Sequence

from tests.reference.samples import Sample, cut, fold, u16

PACKET_BYTES = 36
SAMPLES = 8


def split(raw: bytes) -> list[bytes]:
    """Cut a clean stream into packets; ValueError where it is not clean."""
    return cut(
        raw, PACKET_BYTES, lambda packet: packet[:4] == b"\x55\xaa\x03\x08" and fold(packet[:-2]) == u16(packet, 34)
    )


def compensated(beam: float, distance: int) -> tuple[float, float]:
    """Where a return lies and how far away it is, as the vendor's SDK has it for an X1."""
    if not distance:
        return (beam + 11.0) % 360.0, 0.0
    # In the single precision that distances are told in.
    (away,) = struct.unpack("<f", struct.pack("<f", math.sqrt(distance * distance + 400.0)))
    return (beam + 21.0 + 80.0 - math.degrees(math.atan(distance / 20.0))) % 360.0, away


def decode(packets: Sequence[bytes]) -> list[Sample]:
    """Decode packets."""
    samples: list[Sample] = []
    for number, packet in enumerate(packets):
        first = (u16(packet, 6) - 0xA000) % 23040
        way = (u16(packet, 32) - u16(packet, 6)) % 23040
        for index in range(SAMPLES):
            beam = (first * 7 + way * index) / 448
            word = u16(packet, 8 + 3 * index)
            angle, distance = compensated(beam, 0 if word & 0x8000 else word & 0x3FFF)
            samples.append(Sample(number, index, beam, angle, distance, packet[10 + 3 * index]))
    return samples
