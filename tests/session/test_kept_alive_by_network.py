"""Over a network too, a device with power-down protection is kept alive while the program blocks its event loop."""

from __future__ import annotations

import asyncio
import time

import pytest

from lidario import open_lidar
from lidario.sim.serve import TcpServer
from tests.support.devices import Rig, names
from tests.support.ports import PATIENCE_S, on_both_loops

LONGEST_BLOCK_S = 20.0


@pytest.mark.long
@pytest.mark.real_time
@on_both_loops
async def test_the_thread_writes_what_the_loop_does_not(ydlidar: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop is blocked until the device has heard what keeps it going three times.

    That this is often enough is in `test_keepalive`.
    """
    monkeypatch.setattr("lidario.families.ydlidar.device.KEEPALIVE_S", 0.1)
    written: list[bytes] = []
    with TcpServer(ydlidar.device) as server:
        address = "tcp://{}:{}?family=ydlidar".format(*server.address)
        async with asyncio.timeout(3 * PATIENCE_S), open_lidar(address) as lidar:
            await lidar.set_power_down_protection(True)
            async with lidar.scans() as stream:
                await anext(stream)
                lidar.tap(lambda way, data, at: written.append(data) if way == "out" else None)
                # One may be under way that was written before.
                heard, began = names(ydlidar).count("scan") + 1, time.monotonic()
                while names(ydlidar).count("scan") < heard + 3 and time.monotonic() - began < LONGEST_BLOCK_S:
                    time.sleep(0.01)  # noqa: ASYNC251 - that is what blocks the loop
                assert names(ydlidar).count("scan") >= heard + 3
                assert ydlidar.device.scanning
                # The device may hear a request before the thread has counted it.
                while lidar.stats.keepalives < 3:
                    await asyncio.sleep(0.01)
            while ydlidar.device.scanning:
                await asyncio.sleep(0.01)
            heard = len(names(ydlidar))
            await asyncio.sleep(0.2)
            assert "scan" not in names(ydlidar)[heard:], "behind the stop requests it was written again"
        assert ydlidar.device.lapses == 0
        assert written.count(b"\xa5\x60") >= 3
