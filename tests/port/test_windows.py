"""Serial ports that the event loop cannot wait for: on Windows the same thread reads, by pyserial's own calls.

These tests take that way on Linux. What does not depend on the system is real: pyserial on a pseudo-terminal, the
part of pyserial-asyncio that is meant for Windows, and an event loop that refuses to wait for a terminal.
`test_serial`, `test_blocked_loop` and `test_repeat` have what holds on each system alike.
"""

import asyncio
import time

import pytest

from lidario.session.opening import open_lidar
from lidario.sim.serve import PtyServer
from tests.port.test_thread import threads
from tests.support.devices import both_families, left_still, make_rig
from tests.support.ports import PATIENCE_S

pytestmark = pytest.mark.usefixtures("windows")


@pytest.mark.long
@both_families
async def test_a_session_reads_scans_and_stops_the_device(family: str) -> None:
    rig = make_rig(family)
    with PtyServer(rig.device, chunk=64) as server:
        async with asyncio.timeout(PATIENCE_S), open_lidar(server.path, family=family) as lidar:
            scans = lidar.scans(depth=100)
            first = await anext(scans)
            assert threads()
            time.sleep(0.3)  # noqa: ASYNC251 - a program that blocks its loop
            last = first
            while last.seq < first.seq + 4:
                last = await anext(scans)
            stats = lidar.stats
    # On a busy machine the thread may come too late for what the terminal holds.
    if not server.lost:
        assert (stats.skipped_bytes, stats.lost_packets, stats.broken_scans) == (0, 0, 0)
    assert left_still(rig)
    assert not threads()
