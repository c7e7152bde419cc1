"""Packets of every format with intact check values and any contents at all."""

import numpy as np

from tests.reference import ydlidar
from tests.support.case import Case


def any_packets(case: Case, seed: int, count: int, *, wild: bool) -> list[bytes]:
    """Consecutive packets of random contents; wild ones begin at any angle, and as new streams now and then."""
    random = np.random.default_rng(seed)
    step = int(random.integers(200, 3000))
    # Neighbours differ by less than a quarter, and so no span is a gap.
    jitter = random.integers(-step // 10, step // 10 + 1, count)
    starts = random.integers(0, 0x8000, count) if wild else (np.cumsum(step + jitter) + seed) % 23040
    return case.contents(case, random, starts, wild)


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
