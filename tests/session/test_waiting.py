"""What ends the waiting: of those who wait for their turn, for a device that is busy, or for a stream to begin."""

import asyncio

import pytest

from lidario import Health, Lidar, ResponseTimeout, SessionClosed
from tests.support.devices import Rig, names
from tests.support.times import takes

AT_ONCE_S = 1e-6


async def test_close_ends_also_those_who_wait_for_their_turn(rig: Rig) -> None:
    async with rig.open() as lidar:
        rig.device.mute = True
        asked = [asyncio.ensure_future(call()) for call in (lidar.get_health, lidar.get_info, lidar.reset)]
        await asyncio.sleep(0.02)
        heard = len(rig.device.log)
        closing = asyncio.ensure_future(lidar.close())
        with takes(AT_ONCE_S):
            for each in asked:
                with pytest.raises(SessionClosed):
                    await each
        await closing
    assert not {"get_info", "reset"} & {each.name for each in rig.device.log[heard:]}


async def ask(rig: Rig, lidar: Lidar) -> asyncio.Future[Health]:
    """Ask a question; return as soon as the device has it, 20 ms before its response comes."""
    rig.device.response_delay_s = 0.02
    heard = len(rig.device.log)
    asked = asyncio.ensure_future(lidar.get_health())
    while "get_health" not in names(rig)[heard:]:
        await asyncio.sleep(0.0001)
    return asked


async def test_behind_a_response_that_nobody_waits_for_the_next_request_follows_at_once(rig: Rig) -> None:
    """Until it has responded, the device is busy. It is not waited for until the time of the response is over.

    The response is counted, and dropped.
    """
    async with rig.open() as lidar:
        asked = await ask(rig, lidar)
        asked.cancel()
        # It is asked twice, since responses carry no checksum.
        with takes(0.07, more_than_s=0.059):
            assert await lidar.get_info() == lidar.info
        assert asked.cancelled()
        assert lidar.stats.late_responses == 1


async def test_behind_a_response_the_stop_requests_follow_at_once(rplidar: Rig) -> None:
    async with rplidar.read() as (lidar, _):
        asked = await ask(rplidar, lidar)
        assert rplidar.device.motor_on
        stopping = asyncio.ensure_future(lidar.stop())
        with takes(0.025, more_than_s=0.019):
            while rplidar.device.motor_on:
                await asyncio.sleep(0.0001)
        await asyncio.gather(stopping, asked)


async def test_a_start_that_nobody_wants_any_more_keeps_no_question_waiting(rig: Rig) -> None:
    """The device falls silent as the stream is begun, and its reader leaves."""
    async with rig.open() as lidar:
        await lidar.get_modes()
        rig.device.mute = True
        reading = asyncio.ensure_future(anext(stream := lidar.scans()))
        await asyncio.sleep(0.05)
        with takes(4.0):
            await stream.aclose()
            with pytest.raises(ResponseTimeout):
                await lidar.get_health()
        rig.device.mute = False
        with pytest.raises(StopAsyncIteration):
            await reading
