"""Scalar reference decoder for the scan packets of the YDLIDAR 4ROS.

Angles are device angles: degrees, clockwise, at full precision; the vendor's own decoder truncates them to
1/64°. The device's zero-angle offset is not applied. Only clean streams of scan packets are understood:
`split` raises `ValueError` at the first packet that does not fit, and at any other record between packets.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

HEADER_BYTES = 10
MAX_SAMPLES = 80


@dataclass(frozen=True, slots=True)
class Sample:
    """One measurement."""

    packet: int  # index into the packets given to decode()
    index: int  # place inside that packet
    raw_deg: float  # first angle plus steps: may pass 360 inside a packet
    angle_deg: float  # 0 <= angle_deg < 360
    distance_mm: float  # 0 = no return
    quality: int | None  # always None: the 4ROS sends no intensity
    start: bool  # belongs to a start packet


def split(raw: bytes) -> list[bytes]:
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
        packet = raw[offset : offset + HEADER_BYTES + 2 * count]
        if len(packet) < HEADER_BYTES + 2 * count:
            raise ValueError(f"packet at byte {offset}: incomplete")
        if checksum(packet) != _u16(packet, 8):
            raise ValueError(f"packet at byte {offset}: wrong checksum")
        packets.append(packet)
        offset += len(packet)
    return packets


def checksum(packet: bytes) -> int:
    """XOR of all 16-bit words but the checksum itself."""
    result = 0
    for offset in range(0, len(packet), 2):
        if offset != 8:
            result ^= _u16(packet, offset)
    return result


def is_start(packet: bytes) -> bool:
    """Whether a turn begins with this packet."""
    return packet[2] & 1 == 1


def decode(packets: Sequence[bytes]) -> list[Sample]:
    """Decode packets; each stands for itself."""
    samples: list[Sample] = []
    for number, packet in enumerate(packets):
        count = packet[3]
        first_q6 = _u16(packet, 4) >> 1
        way_q6 = (_u16(packet, 6) >> 1) - first_q6
        if way_q6 < 0:
            way_q6 += 360 * 64
        for index in range(count):
            if count == 1:
                raw_deg = first_q6 / 64
            else:
                # One division, so rounded only once.
                raw_deg = (first_q6 * (count - 1) + way_q6 * index) / (64 * (count - 1))
            distance_mm = float(_u16(packet, HEADER_BYTES + 2 * index))
            samples.append(Sample(number, index, raw_deg, raw_deg % 360.0, distance_mm, None, is_start(packet)))
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


def _u16(data: bytes, offset: int) -> int:
    return int.from_bytes(data[offset : offset + 2], "little")
