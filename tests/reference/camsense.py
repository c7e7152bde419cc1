"""Scalar reference decoder for the packets of a Camsense X1, written from the vendor's SDK alone.

Angles are device angles: degrees, clockwise. Only clean streams of an X1 are understood.
"""

import math
import struct
from collections.abc import Sequence

from tests.reference.samples import Sample, u16

PACKET_BYTES = 36
SAMPLES = 8


def fold(body: bytes) -> int:
    """The check value over all words."""
    check = 0
    for at in range(0, len(body), 2):
        check = (check << 1) + u16(body, at)
    return ((check & 0x7FFF) + (check >> 15)) & 0x7FFF


def split(raw: bytes) -> list[bytes]:
    """Cut a clean stream into packets; ValueError where it is not clean."""
    packets = [raw[at : at + PACKET_BYTES] for at in range(0, len(raw), PACKET_BYTES)]
    for packet in packets:
        if packet[:4] != b"\x55\xaa\x03\x08" or fold(packet[:-2]) != u16(packet, 34):
            raise ValueError("this is no clean stream")
    return packets


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
