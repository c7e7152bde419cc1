"""A device that was told to restart hears nothing until it has booted, whatever became of the task that told it."""

import asyncio
from dataclasses import replace

import pytest

from lidario import ResponseTimeout, SessionClosed
from lidario.families.registry import family_named
from tests.support.devices import Rig, both_families, call, left_still, make_rig, names
from tests.support.times import cancelled, takes

BOOTS_FOR = [0.0, 0.0005, 0.02, 0.3, 0.9]
"""Seconds after which `reset` is cancelled: at once, when RESET was just written, and while the device is asked."""


@pytest.mark.parametrize("name", ["get_health", "get_modes", "set_scan_frequency", "reset", "scan"])
@both_families
async def test_what_follows_a_cancelled_reset_waits_until_the_device_has_booted(family: str, name: str) -> None:
    for seconds in BOOTS_FOR:
        rig = make_rig(family)
        async with rig.open() as lidar:
            await cancelled(lidar.reset(), seconds)
            await call(lidar, name)
            assert seconds == 0.0 or "reset" in names(rig)
        assert left_still(rig)


async def test_a_device_that_boots_as_long_as_any_is_waited_for(rig: Rig) -> None:
    rig.device.boot_s = 0.8 * family_named(rig.family).timing.boot_s
    async with rig.open() as lidar:
        with takes(rig.device.boot_s + 1.5, more_than_s=rig.device.boot_s):
            await lidar.reset()


async def test_a_device_that_never_boots_is_waited_for_only_once(rig: Rig) -> None:
    async with rig.open() as lidar:
        await cancelled(lidar.reset(), 0.2)
        rig.device.receive = lambda data, now: None
        with pytest.raises(ResponseTimeout):
            await lidar.get_health()
        # Behind the first one it was told to stop, and listened to.
        with takes(3.5), pytest.raises(ResponseTimeout):
            await lidar.get_health()


async def test_a_motor_that_turns_behind_a_restart_is_stopped(rig: Rig) -> None:
    """It stood before; no document says whether it does then."""
    async with rig.open() as lidar:
        await lidar.stop()
        await lidar.reset()
        rig.device.log.clear()
    assert "stop" in names(rig)


async def test_what_is_printed_at_boot_is_no_stream() -> None:
    """A stream that nobody asked for is stopped once: a text must not use that up."""
    rig = make_rig("rplidar-a1")
    rig.device.boot_s = 3.0
    rig.device.profile = replace(rig.device.profile, banner=b"It boots. " * 10)
    async with rig.open() as lidar:
        await cancelled(lidar.reset(), 0.05)
        await asyncio.sleep(2.0)
        rig.device.log.clear()
        await asyncio.sleep(2.0)
        assert lidar.stats.drained_bytes + lidar.stats.stray_bytes >= 100
        assert names(rig) == []


async def test_closing_does_not_wait_for_a_boot_that_a_start_would_wait_for(rig: Rig) -> None:
    rig.device.boot_s = 5.0
    async with rig.open() as lidar:
        resetting = asyncio.create_task(lidar.reset())
        await asyncio.sleep(0.1)
        reading = asyncio.create_task(lidar.scan())
        await asyncio.sleep(0.6)
        # A response that the device may owe is waited for for two seconds.
        with takes(2.5):
            await lidar.close()
            ended = await asyncio.gather(resetting, reading, return_exceptions=True)
    assert [type(each) for each in ended] == [SessionClosed, SessionClosed]
