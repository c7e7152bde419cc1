"""Scalar reference decoder for the packets of XV-11 lidars and their relatives, written from the wiki alone.

Angles are device angles: degrees, clockwise. The rotor of an XV-11 turns counter-clockwise: `back`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

PACKET_BYTES = 22
SAMPLES = 4


@dataclass(frozen=True, slots=True)
class Sample:
    """One measurement."""

    packet: int  # index into the packets given to decode()
    index: int  # place inside that packet
    raw_deg: float  # how far the rotor has turned
    angle_deg: float  # 0 <= angle_deg < 360
    distance_mm: float  # 0 = no return
    quality: int


def fold(body: bytes) -> int:
    """The check value of so many words, as the wiki's program has it."""
    check = 0
    for at in range(0, len(body), 2):
        check = (check << 1) + _u16(body, at)
    return ((check & 0x7FFF) + (check >> 15)) & 0x7FFF


def is_packet(packet: bytes) -> bool:
    """Whether these bytes are one."""
    return (
        len(packet) == PACKET_BYTES
        and packet[0] == 0xFA
        and 0xA0 <= packet[1] <= 0xF9
        and fold(packet[:20]) == _u16(packet, 20)
    )


def split(raw: bytes) -> list[bytes]:
    """Cut a clean stream into packets; ValueError where it is not clean."""
    packets = [raw[at : at + PACKET_BYTES] for at in range(0, len(raw), PACKET_BYTES)]
    if not all(map(is_packet, packets)):
        raise ValueError("this is no clean stream")
    return packets


def decode(packets: Sequence[bytes], *, back: bool = True) -> list[Sample]:
    """Decode packets."""
    samples: list[Sample] = []
    for number, packet in enumerate(packets):
        for index in range(SAMPLES):
            turned = 4 * (packet[1] - 0xA0) + index
            word, strength = _u16(packet, 4 + 4 * index), _u16(packet, 6 + 4 * index)
            distance = 0 if word & 0x8000 else word & 0x3FFF
            angle = (360 - turned) % 360 if back else turned
            samples.append(Sample(number, index, float(turned), float(angle), float(distance), min(strength, 2047)))
    return samples


def revolutions(samples: Iterable[Sample]) -> list[list[Sample]]:
    """Whole turns only: one begins where the index falls."""
    turns: list[list[Sample]] = []
    current: list[Sample] | None = None
    previous: Sample | None = None
    for sample in samples:
        if previous is not None and sample.raw_deg < previous.raw_deg:
            if current is not None:
                turns.append(current)
            current = []
        if current is not None:
            current.append(sample)
        previous = sample
    return turns


def _u16(data: bytes, offset: int) -> int:
    return int.from_bytes(data[offset : offset + 2], "little")
