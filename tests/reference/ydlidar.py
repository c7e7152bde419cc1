"""Scalar reference decoder for the scan packets of the YDLIDAR 4ROS, and of its relatives where `Kind` is given.

Angles are device angles: degrees, clockwise, at full precision; the vendor's own decoder truncates them to
1/64°. The device's zero-angle offset is not applied. Only clean streams of scan packets are understood:
`split` raises `ValueError` at the first packet that does not fit, and at any other record between packets.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tests.reference import samples
from tests.reference.samples import u16

HEADER_BYTES = 10
MAX_SAMPLES = 255  # the field is a byte; no document bounds it


@dataclass(frozen=True, slots=True)
class Kind:
    """How the samples of one model are laid out."""

    sample_bytes: int = 2
    unit: int = 1  # parts of a millimetre
    flags: bool = False  # the low two bits of the distance word are none
    intensity_bits: int = 0
    triangle: bool = False


FOUR_ROS = Kind()


@dataclass(frozen=True, slots=True)
class Sample(samples.Sample):
    """One measurement."""

    start: bool  # whether its packet is a start packet


def split(raw: bytes, kind: Kind = FOUR_ROS) -> list[bytes]:
    """Cut a clean stream into packets, verifying mark, sample count and checksum; a broken end is refused."""
    packets: list[bytes] = []
    offset = 0
    while offset < len(raw):
        if raw[offset : offset + 2] != b"\xaa\x55":
            raise ValueError(f"no packet begins at byte {offset}")
        if len(raw) - offset < HEADER_BYTES:
            raise ValueError(f"packet at byte {offset}: incomplete header")
        count = raw[offset + 3]
        if not 1 <= count <= MAX_SAMPLES:
            raise ValueError(f"packet at byte {offset}: {count} samples")
        size = HEADER_BYTES + kind.sample_bytes * count
        packet = raw[offset : offset + size]
        if len(packet) < size:
            raise ValueError(f"packet at byte {offset}: incomplete")
        if checksum(packet, kind) != u16(packet, 8):
            raise ValueError(f"packet at byte {offset}: wrong checksum")
        packets.append(packet)
        offset += len(packet)
    return packets


def checksum(packet: bytes, kind: Kind = FOUR_ROS) -> int:
    """XOR of all 16-bit words but the checksum itself; a byte of intensity counts as a word."""
    result = 0
    for offset in (0, 2, 4, 6):
        result ^= u16(packet, offset)
    for offset in range(HEADER_BYTES, len(packet), kind.sample_bytes):
        if kind.sample_bytes == 3:
            result ^= packet[offset]
        elif kind.sample_bytes == 4:
            result ^= u16(packet, offset)
        result ^= u16(packet, offset + kind.sample_bytes - 2)
    return result


def is_start(packet: bytes) -> bool:
    """Whether a turn begins with this packet."""
    return packet[2] & 1 == 1


def correction_deg(distance_mm: float) -> float:
    """What a model that triangulates adds to the angle of the beam."""
    if distance_mm == 0:
        return 0.0
    return math.degrees(math.atan(21.8 * (155.3 - distance_mm) / (155.3 * distance_mm)))


def decode(packets: Sequence[bytes], kind: Kind = FOUR_ROS) -> list[Sample]:
    """Decode packets; each stands for itself."""
    samples: list[Sample] = []
    for number, packet in enumerate(packets):
        count = packet[3]
        first_q6 = u16(packet, 4) >> 1
        way_q6 = (u16(packet, 6) >> 1) - first_q6
        if way_q6 < 0:
            way_q6 += 360 * 64
        for index in range(count):
            if count == 1:
                raw_deg = first_q6 / 64
            else:
                # One division, so rounded only once.
                raw_deg = (first_q6 * (count - 1) + way_q6 * index) / (64 * (count - 1))
            offset = HEADER_BYTES + kind.sample_bytes * index
            word = u16(packet, offset + kind.sample_bytes - 2)
            distance_mm = (word & 0xFFFC if kind.flags else word) / kind.unit
            quality = None
            if kind.intensity_bits == 10:
                quality = packet[offset] | (word & 3) << 8
            elif kind.intensity_bits == 16:
                quality = u16(packet, offset)
            elif kind.intensity_bits:
                quality = packet[offset]
            angle_deg = (raw_deg + (correction_deg(distance_mm) if kind.triangle else 0.0)) % 360.0
            samples.append(Sample(number, index, raw_deg, angle_deg, distance_mm, quality, is_start(packet)))
    return samples


def revolutions(samples: Iterable[Sample]) -> list[list[Sample]]:
    """Whole turns only, from one start packet up to the next.

    The samples before the first start packet and those from the last one on are left out.
    """
    turns: list[list[Sample]] = []
    current: list[Sample] | None = None  # None until the first start packet
    for sample in samples:
        if sample.start and sample.index == 0:
            if current is not None:
                turns.append(current)
            current = []
        if current is not None:
            current.append(sample)
    return turns
