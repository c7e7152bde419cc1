"""Scalar reference decoder for the packets of XV-11 lidars and their relatives, written from the wiki alone.

Angles are device angles: degrees, clockwise. The rotor of an XV-11 turns counter-clockwise: `back`.
"""

from collections.abc import Sequence

from tests.reference.samples import Sample, u16

PACKET_BYTES = 22
SAMPLES = 4


def fold(body: bytes) -> int:
    """The check value of so many words, as the wiki's program has it."""
    check = 0
    for at in range(0, len(body), 2):
        check = (check << 1) + u16(body, at)
    return ((check & 0x7FFF) + (check >> 15)) & 0x7FFF


def is_packet(packet: bytes) -> bool:
    """Whether these bytes are one."""
    return (
        len(packet) == PACKET_BYTES
        and packet[0] == 0xFA
        and 0xA0 <= packet[1] <= 0xF9
        and fold(packet[:20]) == u16(packet, 20)
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
            word, strength = u16(packet, 4 + 4 * index), u16(packet, 6 + 4 * index)
            distance = 0 if word & 0x8000 else word & 0x3FFF
            angle = (360 - turned) % 360 if back else turned
            samples.append(Sample(number, index, float(turned), float(angle), float(distance), min(strength, 2047)))
    return samples
