"""Scalar reference decoder for the frames of 3irobotix's Delta lidars, written from its documents alone.

Angles are device angles: degrees, clockwise. `split` leaves out frames that are no measurements.
"""

from collections.abc import Sequence

from tests.reference.samples import Sample


def total(body: bytes) -> bytes:
    """The sum behind a frame."""
    return (sum(body) % 65536).to_bytes(2, "big")


def split(raw: bytes) -> list[bytes]:
    """Cut a clean stream into measurement frames; ValueError where it is not clean."""
    packets: list[bytes] = []
    at = 0
    while at < len(raw):
        size = _u16(raw, at + 1) + 2
        frame = raw[at : at + size]
        if frame[0] != 0xAA or len(frame) < size or frame[4] != 0x61 or frame[-2:] != total(frame[:-2]):
            raise ValueError(f"byte {at}: no frame")
        if frame[5] == 0xAD:
            packets.append(frame)
        at += size
    return packets


def decode(packets: Sequence[bytes], *, frames: int = 16) -> list[Sample]:
    """Decode measurement frames; a revolution has `frames`."""
    samples: list[Sample] = []
    for number, packet in enumerate(packets):
        length = _u16(packet, 6)
        head = 5 if (length - 5) % 3 == 0 else 7
        count = (length - head) // 3
        for index in range(count):
            at = 8 + head + 3 * index
            angle = (_u16(packet, 11) / 100 + index * 360 / (frames * count)) % 360
            samples.append(Sample(number, index, angle, angle, _u16(packet, at + 1) / 4, packet[at]))
    return samples


def _u16(data: bytes, offset: int) -> int:
    return int.from_bytes(data[offset : offset + 2], "big")
