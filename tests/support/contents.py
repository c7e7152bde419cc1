"""Packets of every format with intact check values and any contents at all."""

import numpy as np

from lidario.families.ldrobot.simulated import packers as ldrobot
from lidario.families.rplidar.simulated import packers
from tests.reference import ldrobot as ldrobot_reference
from tests.reference import ydlidar
from tests.support.cases import Case

__all__ = ["any_packets", "point_cloud", "resealed", "sealed"]


def any_packets(case: Case, seed: int, count: int, *, wild: bool) -> list[bytes]:
    """Consecutive packets of random contents.

    Args:
        case: The format.
        seed: Decides everything.
        count: How many packets.
        wild: Whether they begin at any angle, and as new streams now and then, or turn as a rotor does.
    """
    random = np.random.default_rng(seed)
    step = int(random.integers(200, 3000))
    jitter = random.integers(-step // 8, step // 8 + 1, count)
    starts = random.integers(0, 0x8000, count) if wild else (np.cumsum(step + jitter) + seed) % 23040
    if case.layout is not None:
        return [
            point_cloud(
                case.layout,
                int(start),
                int((start + random.integers(0, 3000)) % (0x8000 if wild else 23040)),
                random.bytes(case.layout.sample_bytes * int(random.integers(1, 81))),
                control=int(random.choice([0, 1, 14, 255])),
                marked=bool(random.integers(2)),
            )
            for start in starts
        ]
    if case.truth.family == "ldrobot":
        raw = ldrobot.pack_points(
            random.integers(0, 65536, (count, 12)),
            random.integers(0, 256, (count, 12)),
            starts % (0x8000 if wild else 36_000),
            (starts + random.integers(0, 3000, count)) % (0x8000 if wild else 36_000),
            speed=random.integers(0, 65536, count),
        )
        return [raw[at : at + 47] for at in range(0, len(raw), 47)]
    if case.response_type == 0x81:
        quality = random.integers(0, 64, count)
        raw = packers.pack_standard(
            starts % 23040, random.integers(0, 65536, count), quality, np.zeros(count, bool)
        )
        return [raw[at : at + 5] for at in range(0, len(raw), 5)]
    if case.response_type == 0x83:
        angles = random.integers(0, 65536, (count, 96)) if wild else (starts[:, None] + np.arange(96)) % 65536
        flags = random.integers(0, 256, (count, 96))
        # Beyond 24 bits, single precision has no quarters of millimetres any more.
        distances = random.integers(0, 2 ** (32 if wild else 24), (count, 96))
        raw = packers.pack_hq(angles, distances, flags, flags)
        return [raw[at : at + 781] for at in range(0, len(raw), 781)]
    return [
        _capsule(case, random.bytes(len(case.packets[0]) - 2), start | int(wild and random.random() < 0.1) << 15)
        for start in starts.tolist()
    ]


def _capsule(case: Case, contents: bytes, start: int) -> bytes:
    body = bytearray(contents)
    at = 6 if case.response_type == 0x86 else 0
    body[at : at + 2] = start.to_bytes(2, "little")
    return _checked(bytes(body))


def point_cloud(
    layout: ydlidar.Kind, first_q6: int, last_q6: int, samples: bytes, *, control: int = 0, marked: bool = True
) -> bytes:
    """A point cloud packet of these sample bytes, whatever they mean, with an intact check value."""
    angles = b"".join((angle << 1 | marked).to_bytes(2, "little") for angle in (first_q6, last_q6))
    head = bytes((0xAA, 0x55, control, len(samples) // layout.sample_bytes)) + angles
    return resealed(layout, head + bytes(2) + samples)


def resealed(layout: ydlidar.Kind, packet: bytes) -> bytes:
    """A point cloud packet with the check value that its other bytes ask for."""
    return packet[:8] + ydlidar.checksum(packet, layout).to_bytes(2, "little") + packet[10:]


def sealed(case: Case, contents: bytes) -> bytes:
    """A packet of that many bytes with an intact check value: its first two bytes change, and its last may."""
    if case.truth.family == "ldrobot":
        body = case.packets[0][:2] + contents[2:-1]
        return body + bytes((ldrobot_reference.crc8(body),))
    if case.response_type != 0x81:
        return _checked(contents[2:])
    begins = contents[0] & 1
    # Beyond 360 degrees it would be no node.
    angle = int.from_bytes(contents[1:3], "little") % (2 * 23040) | 1
    return bytes([contents[0] & 0xFC | begins | (1 - begins) << 1]) + angle.to_bytes(2, "little") + contents[3:]


def _checked(body: bytes) -> bytes:
    check = 0
    for byte in body:
        check ^= byte
    return bytes([0xA0 | check & 0xF, 0x50 | check >> 4]) + body
