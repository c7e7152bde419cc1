"""The real path, through a whole session: cables pulled, ports shared, programs ended, loops closed."""

from __future__ import annotations

import asyncio

import pytest

from lidario import ConnectFailed, DeviceLost, open_lidar
from lidario.sim.serve import PtyServer
from tests.support.devices import FAMILIES, Rig, make_rig
from tests.support.ports import PATIENCE_S
from tests.support.speeds import SpeedPtyServer


def served(rig: Rig) -> PtyServer:
    return SpeedPtyServer(rig.device, chunk=64)


async def test_a_port_is_opened_by_one_program_alone() -> None:
    rig = make_rig("rplidar")
    with served(rig) as server:
        async with open_lidar(f"serial://{server.path}?family=rplidar&baud=1000000"):
            with pytest.raises(ConnectFailed, match="busy") as caught:
                await open_lidar(server.path)
            assert caught.value.reason == "busy"
        async with open_lidar(f"serial://{server.path}?family=rplidar&baud=1000000"):
            pass


@pytest.mark.parametrize("family", FAMILIES)
async def test_an_unplugged_lidar_ends_the_stream_at_once(family: str) -> None:
    rig = make_rig(family)
    with served(rig) as server:
        async with open_lidar(f"serial://{server.path}?family={family}&baud={rig.device.baudrate}") as lidar:
            stream = lidar.scans()
            await anext(stream)
            server.unplug()
            # Noticed by the hang-up itself: the watchdog, which is slower, would say that no data came.
            with pytest.raises(DeviceLost, match="unplugged"):
                async with asyncio.timeout(PATIENCE_S):
                    async for _ in stream:
                        pass
