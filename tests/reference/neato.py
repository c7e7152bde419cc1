"""Scalar reference decoder for the packets of XV-11 lidars and their relatives, written from the wiki alone.

Angles are device angles: degrees, clockwise. The rotor of an XV-11 turns counter-clockwise: `back`.
"""

from collections.abc import Sequence

from tests.reference.samples import Sample, cut, fold, u16

PACKET_BYTES = 22
SAMPLES = 4


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
    return cut(raw, PACKET_BYTES, is_packet)


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
