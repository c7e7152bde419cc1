"""What a program that blocked its event loop finds: seconds of a stream at once, late and whole."""

from __future__ import annotations

from itertools import pairwise

import pytest

from lidario.scan import Scan
from tests.support.devices import Rig
from tests.support.loop import driven_loop


@pytest.mark.parametrize("block_s", [0.2, 0.8, 3.0])
async def test_revolutions_that_come_late_and_whole_are_delivered(rig: Rig, block_s: float) -> None:
    loop = driven_loop()
    scans: list[Scan] = []
    async with rig.open() as lidar:
        stream = lidar.scans(depth=100)
        while len(scans) < 2:
            scans.append(await anext(stream))
        for _ in range(3):
            loop.block(block_s)
            unblocked = loop.time()
            while scans[-1].stamp_ns * 1e-9 < unblocked:
                scans.append(await anext(stream))
        stats = lidar.stats
    assert (stats.broken_scans, stats.lost_packets, stats.dropped_scans) == (0, 0, 0)
    assert len(scans) >= 3 * block_s / rig.turn_s
    # The packets that came in time tell the time of those that came late.
    for one, other in pairwise(scans):
        assert (other.stamp_ns - one.stamp_ns) * 1e-9 == pytest.approx(rig.turn_s, rel=0.1)
