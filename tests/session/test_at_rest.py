"""Models that hear nothing while DTR is cleared: asked at rest they respond, and rest again after it."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import pytest

from lidario import Unsupported
from lidario.families.ydlidar.simulated.device import PROFILES
from lidario.model import HealthStatus
from tests.support.devices import Rig, call, take

DARK = [name for name, profile in PROFILES.items() if profile.by_dtr]


def is_dark(rig: Rig) -> bool:
    return not rig.device.lit and not rig.device.scanning


@pytest.mark.parametrize("stopped", [True, False], ids=["after stop", "after opening"])
@pytest.mark.parametrize("question", ["get_health", "get_info", "get_scan_frequency", "set_scan_frequency"])
@pytest.mark.parametrize("rig", DARK, indirect=True)
async def test_a_question_at_rest_is_heard_and_leaves_it_at_rest(rig: Rig, question: str, stopped: bool) -> None:
    async with rig.open() as lidar:
        if stopped:
            await take(lidar, 2)
            await lidar.stop()
            assert is_dark(rig)
        # Whoever cannot set its speed refuses; nobody is silent.
        with suppress(Unsupported):
            told = await call(lidar, question)
            assert question != "get_health" or told.status is HealthStatus.OK
        if not stopped:
            await lidar.stop()
            assert is_dark(rig)
        async with asyncio.timeout(5):
            while not is_dark(rig):
                await asyncio.sleep(0.1)
        assert len(await take(lidar, 2)) == 2
    assert is_dark(rig)


@pytest.mark.long
@pytest.mark.parametrize("before", ["opened", "stopped", "scanned"])
@pytest.mark.parametrize("rig", DARK, indirect=True)
async def test_a_question_is_heard_although_another_task_stops_the_device_meanwhile(rig: Rig, before: str) -> None:
    """What stops it makes it deaf. It is woken again, and rests behind the question."""
    for turn in range(1 + len(before) % 3, 30, 3):
        async with rig.open() as lidar:
            if before == "scanned":
                await lidar.scan()
            elif before == "stopped":
                await lidar.stop()
            asking = asyncio.ensure_future(lidar.get_info())
            for _ in range(turn):
                await asyncio.sleep(0)
            late = asking.done()
            await lidar.stop()
            assert (await asking).family == rig.family
            await asyncio.sleep(0.5)
            assert is_dark(rig), turn
        if late:
            break
