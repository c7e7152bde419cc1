"""What ends the waiting: of those who wait for their turn, for a device that is busy, or for a stream to begin."""

import asyncio

import pytest

from lidario import Health, Lidar, SessionClosed
from lidario.session.talking.waiting import Awaited, Waiting
from tests.support.devices import Rig, left_still, names, take
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
    """Until it has responded, the device is busy. It is not waited for until the time of the response is over."""
    async with rig.open() as lidar:
        asked = await ask(rig, lidar)
        asked.cancel()
        # It is asked twice, since responses carry no checksum.
        with takes(0.07, more_than_s=0.059):
            await lidar.get_info()


async def test_behind_a_response_the_stop_requests_follow_at_once(rplidar: Rig) -> None:
    async with rplidar.read() as (lidar, _):
        asked = await ask(rplidar, lidar)
        assert rplidar.device.motor_on
        stopping = asyncio.ensure_future(lidar.stop())
        with takes(0.025, more_than_s=0.019):
            while rplidar.device.motor_on:
                await asyncio.sleep(0.0001)
        await asyncio.gather(stopping, asked)


async def test_the_last_reader_leaves_just_as_the_stream_begins(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The device has said that it streams; the task that waited for that goes on after the reader has left."""
    leaving = list[asyncio.Future[None]]()
    async with rig.open() as lidar:
        stream = lidar.scans()
        wake = Waiting.wake

        def leave_and_wake(self: Waiting, what: Awaited, result: bytes = b"") -> None:
            if what is Awaited.RESPONSE and rig.device.scanning and not leaving:
                leaving.append(asyncio.ensure_future(stream.aclose()))
            wake(self, what, result)

        monkeypatch.setattr(Waiting, "wake", leave_and_wake)
        with pytest.raises(StopAsyncIteration):
            await anext(stream)
        await leaving[0]
        assert left_still(rig)
        assert not lidar.is_scanning
        assert len(await take(lidar, 2)) == 2
    assert not caplog.records
