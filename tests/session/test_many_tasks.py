"""Three or four tasks at once, drawn by a seed: timeouts, cancel scopes, cancellations, groups that fail, a cable.

The matrix of two tasks tries every step; here is what only several tasks make: one that waits for the lock while a
second one stops, a third one leaves and the line is lost. After each: every call has ended with a result or with an
error of ours, the device is still where nobody reads, no timer and no task is left, and the counters add up
(`tests.conftest`).
"""

import asyncio
import gc
import random
from collections.abc import Awaitable, Callable
from contextlib import suppress

import anyio
import pytest

from lidario import Lidar, LidarError, LocalProtocolError, StreamFailed
from tests.support.cable import Cable, cable_to, on_a_cable
from tests.support.devices import EVERY_FAMILY, Rig, end_of, left_still, make_rig, scanning, some
from tests.support.loop import driven_loop, now
from tests.support.times import begun, takes

LONGEST_S = 40.0
"""No call takes longer: a speed that is not reached, behind a boot and a reconnection."""
LONGEST_CLOSE_S = 8.0


async def read(lidar: Lidar) -> None:
    async with lidar.scans(depth=2) as stream:
        await some(stream, 3)


async def leave_at_once(lidar: Lidar) -> None:
    async for _ in lidar.scans():
        break


async def fail_in_the_body(lidar: Lidar) -> None:
    with suppress(ZeroDivisionError):
        async for _ in lidar.scans():
            raise ZeroDivisionError


async def read_sectors(lidar: Lidar) -> None:
    async with lidar.sectors(90) as stream:
        await some(stream, 6)


async def tap(lidar: Lidar) -> None:
    def fails(*_: object) -> None:
        raise KeyError("a tap")

    lidar.tap(fails)
    await lidar.scan()


CALLS: list[Callable[[Lidar], Awaitable[object]]] = [
    read, leave_at_once, fail_in_the_body, read_sectors, tap, Lidar.scan, lambda lidar: lidar.scan("Standard"),
    Lidar.get_health, Lidar.get_modes, lambda lidar: lidar.set_scan_frequency(8.0), Lidar.reset, Lidar.stop,
]  # fmt: skip


class Fails(Exception):
    """Ends a task group."""


class Program:
    """What the tasks of one seed do."""

    def __init__(self, seed: int, lidar: Lidar, cable: Cable) -> None:
        self.pulled = False  # whether the cable was pulled out
        self.longest_s = 0.0  # the longest call
        self._random = random.Random(seed)
        self._lidar = lidar
        self._cable = cable

    async def run(self) -> None:
        """Several tasks, of which some are cancelled, or all by a group that fails."""
        tasks = self._random.randint(3, 4)
        if self._random.random() < 0.5:
            # What else a task raises is a defect, and leaves this method.
            try:
                async with asyncio.TaskGroup() as group:
                    for _ in range(tasks):
                        group.create_task(self._work())
                    await asyncio.sleep(self._random.choice([0.01, 0.1, 0.5, 1.5]))
                    raise Fails
            except* Fails:
                pass
            return
        started = [asyncio.ensure_future(self._work()) for _ in range(tasks)]
        await asyncio.sleep(self._random.choice([0.01, 0.1, 0.5, 1.5]))
        for task in started[:2]:
            task.cancel()
        for found in await asyncio.gather(*started, return_exceptions=True):
            assert found is None or isinstance(found, asyncio.CancelledError), repr(found)

    async def _work(self) -> None:
        for _ in range(self._random.randint(1, 4)):
            await asyncio.sleep(self._random.choice([0, 0.001, 0.05, 0.3, 1.2]))
            if self._random.random() < 0.1:
                self._lose_the_line()
            began = now()
            with suppress(LidarError, TimeoutError, StopAsyncIteration):
                await self._call(
                    self._random.choice(CALLS), self._random.choice([None, None, 0.001, 0.05, 0.2, 1.0])
                )
            self.longest_s = max(self.longest_s, now() - began)

    async def _call(self, call: Callable[[Lidar], Awaitable[object]], at_most_s: float | None) -> None:
        if at_most_s is None:
            await call(self._lidar)
        elif self._random.random() < 0.5:
            async with asyncio.timeout(at_most_s):
                await call(self._lidar)
        else:
            with anyio.move_on_after(at_most_s), anyio.CancelScope(shield=self._random.random() < 0.3):
                await call(self._lidar)

    def _lose_the_line(self) -> None:
        """Pull the cable out; it is put in again whatever becomes of this task."""
        self.pulled = True
        self._cable.pull()
        asyncio.get_running_loop().call_later(self._random.choice([0.01, 0.5]), self._put_in)

    def _put_in(self) -> None:
        if self._cable.device is None:
            self._cable.plug()


@pytest.mark.parametrize("turns", [1, 2, 3])
async def test_none_is_left_where_a_session_is_closed_as_its_line_is_lost(turns: int) -> None:
    """A stream waits until the device is free, behind questions that fail one after the other."""
    with cable_to(make_rig("rplidar")) as cable:
        lidar = await cable.rig.open()
        asking = [asyncio.create_task(lidar.get_health()) for _ in range(4)]
        await asyncio.sleep(0)
        reading = await begun(lidar.scan())
        cable.pull()
        for _ in range(turns):
            await asyncio.sleep(0)
        await lidar.close()
        assert asyncio.all_tasks() - {asyncio.current_task(), reading, *asking} == set()
        await asyncio.gather(reading, *asking, return_exceptions=True)


def cancel_all_others() -> None:
    for task in asyncio.all_tasks() - {asyncio.current_task()}:
        task.cancel()


@pytest.mark.parametrize("turns", [0, 1, 5, 20])
async def test_no_reader_waits_for_ever_where_all_tasks_are_cancelled(rplidar: Rig, turns: int) -> None:
    async with rplidar.open() as lidar:
        stream = lidar.scans()
        reading = await begun(anext(stream), 1 + turns)
        cancel_all_others()
        with pytest.raises(asyncio.CancelledError):
            await reading
        with pytest.raises(LocalProtocolError, match="cancelled the task that starts the stream"):
            await asyncio.wait_for(anext(stream), 30.0)
        assert (await lidar.get_health()).ok
        assert await lidar.scan()
        await lidar.stop()
        assert left_still(rplidar)


@pytest.mark.parametrize("away_s", [0.0, 1.0])
async def test_a_program_that_cancels_all_tasks_while_a_session_comes_back_has_ended_it(away_s: float) -> None:
    async with on_a_cable("rplidar") as (cable, lidar), scanning(lidar) as stream:
        cable.pull()
        await asyncio.sleep(away_s)
        cancel_all_others()
        await end_of(stream, LocalProtocolError, "cancelled the task that brings the session back")
        with pytest.raises(LocalProtocolError, match="cancelled the task that brings the session back"):
            await lidar.get_health()
        assert [change.state async for change in lidar.line_changes()] == []


async def test_a_stream_that_was_to_go_on_tells_that_all_tasks_were_cancelled(rplidar: Rig) -> None:
    async with rplidar.read() as (lidar, stream):
        await lidar.get_health()
        cancel_all_others()
        await end_of(stream, StreamFailed, "cancelled the task that starts the stream")


@pytest.mark.long
@pytest.mark.usefixtures("quick_collection")
@pytest.mark.parametrize("family", EVERY_FAMILY)
@pytest.mark.parametrize("reconnect", [False, True])
@pytest.mark.exhaustive("seed", sample=[1], full=range(4))
async def test_many_tasks_at_once(family: str, seed: int, *, reconnect: bool) -> None:
    rig = make_rig(family)
    loop = driven_loop()
    with cable_to(rig) as cable:
        lidar = await rig.open(reconnect=reconnect)
        program = Program(seed, lidar, cable)
        await program.run()
        assert program.longest_s < LONGEST_S
        gc.collect()
        await asyncio.sleep(4.0)
        assert not lidar.is_scanning
        assert program.pulled or left_still(rig)
        with takes(LONGEST_CLOSE_S):
            await lidar.close()
        assert program.pulled or left_still(rig)
    await asyncio.sleep(0)
    assert loop.timers == []
