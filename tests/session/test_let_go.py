"""A session that nobody holds any more is collected, whatever it has failed with."""

import asyncio
import gc
import time
import weakref
from collections.abc import Callable
from contextlib import closing
from itertools import count
from typing import Any
from unittest.mock import patch

import pytest

from lidario import Lidar
from lidario.families.registry import family_named
from lidario.port.simulated import connect_in_memory
from lidario.session.talking.dialogue import Dialogue
from lidario.session.talking.handshake import introduce
from tests.support.devices import EVERY_KIND, Rig, both_families, hears_only, left_still, make_rig, names
from tests.support.loop import DrivenLoop, driven_loop
from tests.support.times import cancelled


@both_families
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
    assert refs[0]() is None, gc.get_referrers(refs[0]())


async def test_who_keeps_the_error_of_a_cancelled_setting_keeps_no_stream(rig: Rig) -> None:
    """The setting reads scans to measure the speed; the reader before is gone meanwhile."""
    async with rig.open() as lidar:
        await lidar.scan()
        setting = asyncio.ensure_future(lidar.set_scan_frequency(8.0))
        while rig.device.motor.target_rpm != 480.0:
            await asyncio.sleep(0.001)
        await asyncio.sleep(0.05)
        assert not setting.done()
        setting.cancel()
        with pytest.raises(asyncio.CancelledError) as kept:
            await setting
        assert kept.value.__traceback__ is not None
        await asyncio.sleep(2.0)
        assert not lidar.is_scanning
        assert left_still(rig)


@pytest.mark.parametrize("sectors", [False, True])
@pytest.mark.parametrize("awaited", [False, True])
async def test_who_keeps_a_cancelled_task_keeps_no_stream(rig: Rig, *, sectors: bool, awaited: bool) -> None:
    """Its error holds the frames in which it was raised. What they iterated over is garbage all the same."""
    async with rig.open() as lidar:
        began = asyncio.Event()

        async def read() -> None:
            async for _ in lidar.sectors() if sectors else lidar.scans():
                began.set()

        reading = asyncio.ensure_future(read())
        await began.wait()
        reading.cancel()
        kept: Any = await (asyncio.gather(reading, return_exceptions=True) if awaited else asyncio.wait([reading]))
        await asyncio.sleep(2.0)
        assert not lidar.is_scanning
        assert left_still(rig)
        del kept


async def test_a_session_that_is_let_go_in_the_midst_of_a_start_leaves_no_task(rig: Rig) -> None:
    """It waited for the stop requests, which nobody wrote any more, ten times a second and for ever."""
    with patch.object(time, "sleep", asyncio.get_running_loop().block):  # type: ignore[attr-defined]
        lidar = await rig.open()
        async with lidar.scans() as scans:
            await anext(scans)
        await cancelled(lidar.scan())
        del lidar, scans
        gc.collect()
        await asyncio.sleep(1.0)
    assert [task for task in asyncio.all_tasks() if task is not asyncio.current_task()] == []


async def test_who_lets_it_go_has_the_last_word(rig: Rig) -> None:
    """Timers had begun to stop the device. They were late, since the loop was blocked, and asked it behind STOP."""
    loop = driven_loop()
    with patch.object(time, "sleep", loop.block):
        for after_ms in range(5, 100, 10):
            lidar = await rig.open()
            reading = asyncio.ensure_future(lidar.scan())
            while not lidar.is_scanning:
                await asyncio.sleep(0.001)
            reading.cancel()
            await asyncio.sleep(after_ms / 1000)
            loop.block(0.1)
            del lidar, reading
            gc.collect()
            await asyncio.sleep(2.0)
            assert left_still(rig), after_ms


@pytest.mark.parametrize(("stands_s", "gathers_s"), [(0.02, 0.0), (0.0, 0.004)], ids=["program", "adapter"])
async def test_a_finalizer_waits_long_enough_behind_a_late_stop(
    rig: Rig, stands_s: float, gathers_s: float
) -> None:
    """A busy machine lets a program stand just before it writes; an adapter gathers bytes."""
    loop, family = driven_loop(), family_named(rig.family)
    dialogue = Dialogue(connect_in_memory(rig.device), family.device(), family.timing)
    await introduce(dialogue, 1.0)
    heard = rig.device.receive

    def late(data: bytes, at_ns: int) -> None:
        rig.device.receive = heard
        loop.block(stands_s)
        heard(data, at_ns + round((stands_s + gathers_s) * 1e9))

    rig.device.receive = late
    with patch.object(time, "sleep", loop.block):
        dialogue.write((dialogue.device.stop(),))
        dialogue.abandon()
    assert names(rig)[-1] == names(rig)[-3] == "stop"
    await asyncio.sleep(0)


def blocks_for(rig: Rig, hears: Callable[[bytes], bool]) -> float:
    """Let go of a session in mid-scan, whose device then hears this alone; how long that blocks the program."""
    loop = DrivenLoop()

    async def main() -> float:
        lidar = await rig.open()
        stream = lidar.scans()
        await anext(stream)
        hears_only(rig, hears)
        return loop.time()

    with patch.object(time, "sleep", loop.block):
        with closing(loop):
            began = loop.run_until_complete(main())
        gc.collect()
    return loop.time() - began


@pytest.mark.parametrize("lost", range(2))
def test_one_of_the_stop_requests_may_be_lost(rig: Rig, lost: int) -> None:
    """Of a session that is garbage nobody listens to the line any more."""
    written = count()
    blocks_for(rig, lambda _: next(written) != lost)
    assert next(written) >= 2
    assert left_still(rig)


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_letting_go_blocks_for_80_ms_at_most(kind: str) -> None:
    """As docs/architecture.md says. A device that needs a longer pause behind STOP acknowledges that."""
    rig = make_rig(kind)
    assert blocks_for(rig, lambda _: True) <= 0.08
    assert left_still(rig)
