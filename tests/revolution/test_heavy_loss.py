"""Most packets are lost, by bytes that are missing everywhere: what is told stays within what can be true."""

from functools import cache

import numpy as np
import pytest

from benchmarks import damage
from benchmarks.streams import KINDS, capture
from lidario.revolution.assemble import AssemblerStats
from lidario.scan import Scan
from lidario.wire.envelope import DESCRIPTOR_SIZE

SECONDS = 6.0


@cache
def thinned(name: str, share: float, seed: int) -> tuple[list[Scan], AssemblerStats, int]:
    """Scans, counters and the number of packets that came, of six seconds that lose a share of their bytes."""
    raw = np.frombuffer(capture(KINDS[name], SECONDS), np.uint8)[DESCRIPTOR_SIZE:]
    left = np.flatnonzero(np.random.default_rng(seed).random(len(raw)) >= share)
    scans, stats, packets, _ = damage._received(KINDS[name], raw[left], left)
    return scans, stats, packets


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.exhaustive("share", sample=[0.05], full=[0.01, 0.02, 0.03, 0.05, 0.1])
@pytest.mark.exhaustive("seed", sample=[1], full=[1, 2, 3])
def test_no_more_is_told_than_there_was(name: str, share: float, seed: int) -> None:
    """0x81 has no check value: false marks divide its revolutions. The start packets of a 4ROS hold one sample."""
    clean, _, sent = thinned(name, 0.0, 1)
    scans, stats, packets = thinned(name, share, seed)
    # The first, partial revolution may have been taken for a whole one.
    assert len(scans) <= len(clean) + 1
    assert len(scans) + stats.missed_scans <= 1.1 * len(clean) + 1
    # Of 0x81, damaged bytes may pass for nodes, so that fewer seem to be missing than are.
    assert stats.lost_packets <= 1.05 * (sent - packets) + 10
    numbers = [scan.seq for scan in scans]
    assert numbers == sorted(set(numbers))
