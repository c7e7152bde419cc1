"""A program whose loop runs a new task at once, up to its first pause, as `asyncio.eager_task_factory` does.

A stream that had ended was not started again there: the task that starts streams noted that it had ended before it
was noted that it had begun.
"""

import asyncio
from typing import Any

import pytest

from tests.support.cable import next_after, on_a_cable
from tests.support.devices import EVERY_FAMILY, FAMILIES, left_still, make_rig, scanning
from tests.support.loop import now

PATIENCE_S = 30.0
FACTORY: Any = getattr(asyncio, "eager_task_factory", None)  # from Python 3.12 on


def make_eager() -> None:
    asyncio.get_running_loop().set_task_factory(FACTORY)


@pytest.mark.parametrize("family", EVERY_FAMILY)
async def test_streams_one_after_another(family: str) -> None:
    make_eager()
    rig = make_rig(family)
    async with rig.open() as lidar:
        for _ in range(3):
            async with asyncio.timeout(PATIENCE_S):
                await lidar.scan()
        for _ in range(3):
            async with asyncio.timeout(PATIENCE_S), lidar.scans() as stream:
                await anext(stream)
            readers = [asyncio.create_task(lidar.scan()) for _ in range(3)]
            async with asyncio.timeout(PATIENCE_S):
                await asyncio.gather(*readers)
    assert left_still(rig)


@pytest.mark.parametrize("family", FAMILIES)
async def test_a_question_in_mid_scan(family: str) -> None:
    make_eager()
    rig = make_rig(family)
    async with rig.read() as (lidar, stream):
        for _ in range(3):
            async with asyncio.timeout(PATIENCE_S):
                await lidar.get_health()
                await anext(stream)
    assert left_still(rig)


@pytest.mark.parametrize("family", EVERY_FAMILY)
async def test_coming_back(family: str) -> None:
    make_eager()
    async with on_a_cable(family) as (cable, lidar), scanning(lidar) as stream:
        for _ in range(2):
            cable.pull()
            await asyncio.sleep(1.0)
            cable.plug()
            await next_after(stream, now())
