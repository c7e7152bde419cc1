"""A session that nobody holds any more is collected, whatever it has failed with."""

from __future__ import annotations

import asyncio
import gc
import weakref
from typing import Any

from lidario import Lidar
from tests.support.devices import both_families, make_rig
from tests.support.loop import driven


@both_families
@driven
async def test_an_error_that_is_kept_holds_nothing_of_the_program(family: str) -> None:
    """The line is lost while the stop requests are written, and these while a cancelled task leaves its stream."""
    rig = make_rig(family)
    heard = rig.device.receive
    refs: list[weakref.ref[Lidar]] = []

    def unplugged(data: bytes, now: int) -> None:
        raise OSError("the line was unplugged")

    async def program() -> None:
        lidar = await rig.open()
        refs.append(weakref.ref(lidar))
        began = asyncio.Event()

        async def read() -> None:
            async with lidar.scans() as stream:
                async for _ in stream:
                    began.set()

        reading = asyncio.ensure_future(read())
        await began.wait()
        rig.device.receive = unplugged
        reading.cancel()
        await asyncio.wait([reading])
        assert not lidar.is_connected

    await program()
    rig.device.receive = heard
    gc.collect()
    assert refs[0]() is None, told(refs[0]())


def told(kept: Any) -> list[str]:
    return [type(each).__name__ for each in gc.get_referrers(kept)]
