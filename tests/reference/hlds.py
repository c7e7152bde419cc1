"""Scalar reference decoder for the packets of an LDS-01, written from ROBOTIS' driver alone.

Angles are device angles: degrees, clockwise.
"""

from collections.abc import Sequence

from tests.reference.samples import Sample, cut, u16

PACKET_BYTES = 42
SAMPLES = 6


def twice(body: bytes) -> bytes:
    """The check bytes that the golden stream has."""
    return bytes((255 - sum(body) % 256,)) * 2


def is_packet(packet: bytes) -> bool:
    """Whether these bytes are one with those check bytes."""
    return (
        len(packet) == PACKET_BYTES
        and packet[0] == 0xFA
        and 0xA0 <= packet[1] <= 0xDB
        and packet[40:] == twice(packet[:40])
    )


def split(raw: bytes) -> list[bytes]:
    """Cut a clean stream into packets; ValueError where it is not clean."""
    return cut(raw, PACKET_BYTES, is_packet)


def decode(packets: Sequence[bytes]) -> list[Sample]:
    """Decode packets."""
    samples: list[Sample] = []
    for number, packet in enumerate(packets):
        for index in range(SAMPLES):
            turned = float(SAMPLES * (packet[1] - 0xA0) + index)
            intensity, distance = u16(packet, 4 + 6 * index), u16(packet, 6 + 6 * index)
            samples.append(Sample(number, index, turned, turned, float(distance), min(intensity, 8191)))
    return samples
