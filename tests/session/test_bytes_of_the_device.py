"""Every byte that the device has sent is counted as received, or was lost by the line: none vanishes in between.

The ledger (`tests/support/ledger.py`) begins where bytes are parsed. Here the device itself counts.
"""

import asyncio
import time
from itertools import pairwise
from typing import Any

import pytest

from lidario.session.lidar import Lidar
from lidario.session.opening import open_lidar
from lidario.sim.serve import PtyServer
from tests.support.devices import Rig, take
from tests.support.ports import PATIENCE_S


class Sent:
    """Counts what a simulated device sends."""

    def __init__(self, rig: Rig) -> None:
        self.bytes = 0
        self._transmit = rig.device.transmit
        rig.device.transmit = self._count

    def _count(self, now: int) -> Any:
        data = self._transmit(now)
        self.bytes += len(data)
        return data


async def use(lidar: Lidar) -> None:
    """Scans, a query in the midst of them, and the end of the stream."""
    await take(lidar, 2)
    stream = lidar.scans()
    await anext(stream)
    await lidar.get_health()
    await anext(stream)
    await stream.aclose()
    await lidar.stop()


async def test_in_memory(rig: Rig) -> None:
    sent = Sent(rig)
    async with rig.open() as lidar:
        await use(lidar)
        assert lidar.stats.bytes_received == sent.bytes > 20_000


@pytest.mark.long
@pytest.mark.real_time
async def test_on_a_terminal_whose_reader_is_blocked(rig: Rig) -> None:
    """Also what the thread has read while the loop stood still, and what came behind the STOP."""
    sent = Sent(rig)
    with PtyServer(rig.device) as server:
        async with asyncio.timeout(PATIENCE_S), open_lidar(server.path, family=rig.family) as lidar:
            async with lidar.scans(depth=50) as stream:
                scans = [await anext(stream)]
                time.sleep(0.4)  # noqa: ASYNC251 - a program that blocks its loop
                unblocked = time.monotonic_ns()
                while scans[-1].stamp_ns < unblocked:
                    scans.append(await anext(stream))
            await lidar.stop()
            # What the kernel still carries arrives by itself.
            deadline = time.monotonic() + 2.0
            while lidar.stats.bytes_received + server.lost < sent.bytes and time.monotonic() < deadline:
                await asyncio.sleep(0.005)
            stats = lidar.stats
            assert stats.bytes_received + server.lost == sent.bytes
    if not server.lost:
        assert (stats.skipped_bytes, stats.lost_packets, stats.dropped_scans) == (0, 0, 0)
        assert all(later.seq == before.seq + 1 for before, later in pairwise(scans))
