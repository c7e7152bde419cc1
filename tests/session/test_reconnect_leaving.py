"""How a session ends that is away, or has come back: where the stop requests go, and what is let go of."""

import asyncio
import gc
import weakref

import pytest

from lidario import Lidar
from tests.support.cable import Cable, cable_to, next_after, on_a_cable
from tests.support.devices import Rig, left_still, scanning
from tests.support.loop import DrivenLoop, now, unless_unfinished

pytestmark = pytest.mark.usefixtures("quick_collection")
ON_THE_WAY_S = [0.001, 0.02, 0.045, 0.06, 0.08, 0.15]
"""Moments after an attempt has begun: it is asked what it is, then how it is, then it scans."""
on_the_way = pytest.mark.exhaustive("after_s", sample=ON_THE_WAY_S[::3], full=ON_THE_WAY_S)


async def away_and_reached_again(cable: Cable, after_s: float) -> None:
    """The cable is out for 2 s; return so long after the next attempt to reach the device was begun."""
    cable.pull()
    await asyncio.sleep(2.0)
    cable.plug(boots=False)
    attempts = len(cable.attempts)
    async with asyncio.timeout(5.0):
        while len(cable.attempts) == attempts:
            await asyncio.sleep(0.001)
    await asyncio.sleep(after_s)


@pytest.mark.parametrize("told", ["nothing", "to stop and closed", "to stop"])
@on_the_way
async def test_the_motor_that_shall_go_on_does_unless_the_session_has_said_so_on_the_way(
    after_s: float, told: str
) -> None:
    async with on_a_cable("rplidar", keep_spinning=True) as (cable, lidar):
        await lidar.scan()
        await away_and_reached_again(cable, after_s)
        if told != "nothing":
            await lidar.stop(motor=True)
        if told == "to stop":
            await asyncio.sleep(3.0)
            assert lidar.is_connected
            assert left_still(cable.rig)
    assert not cable.rig.device.scanning
    assert cable.rig.device.motor_on is (told == "nothing")
    assert told == "nothing" or left_still(cable.rig)


async def test_the_motor_that_shall_go_on_does_behind_a_stream_that_came_back() -> None:
    async with on_a_cable("rplidar", keep_spinning=True) as (cable, lidar), scanning(lidar) as stream:
        cable.pull()
        cable.plug(boots=False)
        await next_after(stream, now())
    assert (cable.rig.device.scanning, cable.rig.device.motor_on) == (False, True)


@on_the_way
def test_the_loop_is_closed_on_the_way(rig: Rig, after_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    loop = DrivenLoop()
    loop.set_exception_handler(unless_unfinished)
    monkeypatch.setattr("lidario.port.port.time.sleep", loop.block)

    async def main() -> Lidar:
        lidar = await rig.open(reconnect=True)
        stream = lidar.scans()
        await anext(stream)
        await away_and_reached_again(cable, after_s)
        return lidar

    with cable_to(rig) as cable:
        lidar = loop.run_until_complete(main())
        loop.close()
        del lidar
        gc.collect()


@on_the_way
async def test_a_session_that_nobody_holds_any_more_ends_while_it_is_away(rig: Rig, after_s: float) -> None:
    with cable_to(rig) as cable:
        lidar = await rig.open(reconnect=True)
        await lidar.scan()
        gone = weakref.ref(lidar)
        await away_and_reached_again(cable, after_s)
        del lidar
        gc.collect()
        assert gone() is None
        await asyncio.sleep(3.0)
        attempts = len(cable.attempts)
        await asyncio.sleep(3.0)
        assert len(cable.attempts) == attempts
        assert left_still(rig)
