"""A simulated lidar of a user's tests that nothing is asked: what happens to its cable is seen all the same."""

import asyncio

import pytest

import lidario
from lidario.testing import SimulatedLidar
from tests.support.children import until


@pytest.mark.parametrize("after_s", [0.0, 2.0])
async def test_a_session_at_rest_sees_the_cable_go(after_s: float) -> None:
    """Nothing was read of a line on which nothing was asked."""
    lidar = SimulatedLidar()
    async with lidario.open_lidar(lidar) as session:
        await asyncio.sleep(5.0)
        lidar.fail(f"unplug:{after_s}s")
        await asyncio.sleep(after_s / 2)
        connected = [session.is_connected]
        await asyncio.sleep(after_s / 2 + 0.1)
        assert [*connected, session.is_connected] == [True, False]
        with pytest.raises(lidario.DeviceLost):
            await session.get_info()
    lidar.close()


async def test_a_session_at_rest_comes_back() -> None:
    lidar = SimulatedLidar()
    async with lidario.open_lidar(lidar, reconnect=True) as session:
        lidar.fail("replug:0s")
        async with asyncio.timeout(60.0):
            async for change in session.line_changes():
                if change.state == "back":
                    break
        assert session.stats.reconnects == 1
        assert (await session.get_info()).serial == session.info.serial
    lidar.close()


@pytest.mark.long
def test_a_session_of_another_thread_sees_the_cable_go() -> None:
    lidar = SimulatedLidar()
    with lidario.open_sync(lidar) as session:
        lidar.fail("unplug:0s")
        until(lambda: not session.is_connected)
    lidar.close()
