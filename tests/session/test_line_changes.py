"""Programs that show a lidar are told when its line is lost, and when it is back."""

import asyncio
import gc
import threading
from typing import Any

import pytest

import lidario
from lidario.errors import Busy
from lidario.session.streaming.line_changes import LineChange, LineChanges, LineWatch
from tests.support.cable import on_a_cable
from tests.support.devices import Rig, both_families, end_of


async def all_of(changes: LineChanges) -> list[LineChange]:
    return [change async for change in changes]


@pytest.mark.parametrize("scanning", [False, True])
async def test_each_loss_and_each_return_is_told(rig: Rig, scanning: bool) -> None:
    async with on_a_cable(rig) as (cable, lidar):
        reading = asyncio.ensure_future(all_of(lidar.line_changes()))
        stream = lidar.scans() if scanning else None
        if stream is not None:
            await anext(stream)
        for _ in range(2):
            cable.pull()
            await asyncio.sleep(3.0)
            late = lidar.line_changes()
            change = await anext(late)
            assert (change.state, lidar.is_connected) == ("away", False)
            cable.plug()
            assert (await anext(late)).state == "back"
            assert lidar.is_connected
            if stream is not None:
                await anext(stream)
    changes = await reading
    assert [change.state for change in changes] == ["connected", "away", "back", "away", "back"]
    assert [bool(change.reason) for change in changes] == [False, True, False, True, False]
    assert [change.stamp_ns for change in changes] == sorted(change.stamp_ns for change in changes)
    assert changes[2].stamp_ns - changes[1].stamp_ns > 2e9
    assert "unplugged" in changes[1].reason


@pytest.mark.parametrize(
    ("reconnect", "states", "why"),
    [
        (False, ["connected", "ended"], "unplugged"),
        (lidario.Reconnect(limit_s=2.0), ["connected", "away", "ended"], "did not come back within 2 s"),
    ],
    ids=["at once", "at the limit"],
)
@both_families
async def test_without_coming_back_it_ends(family: str, reconnect: Any, states: list[str], why: str) -> None:
    async with on_a_cable(family, reconnect=reconnect) as (cable, lidar):
        reading = asyncio.ensure_future(all_of(lidar.line_changes()))
        stream = lidar.scans()
        await anext(stream)
        cable.pull()
        lost = await end_of(stream, lidario.DeviceLost)
        changes = await reading
        assert [change.state for change in changes] == states
        assert str(lost) == changes[-1].reason
        assert why in changes[-1].reason
        assert await all_of(lidar.line_changes()) == []


async def test_a_session_that_is_let_go_ends_it(rplidar: Rig) -> None:
    lidar = await rplidar.open()
    reading = asyncio.ensure_future(all_of(lidar.line_changes()))
    await asyncio.sleep(0.1)
    del lidar
    gc.collect()
    assert [change.state for change in await reading] == ["connected"]


def test_an_end_that_another_thread_tells_is_seen_at_once() -> None:
    """The garbage collector may let go of a session in any thread, while the loop sleeps, in true time."""

    async def main() -> None:
        watch = LineWatch()
        reading = asyncio.ensure_future(all_of(watch.read()))
        await asyncio.sleep(0.05)
        threading.Timer(0.1, watch.end).start()
        await asyncio.wait_for(reading, 10.0)

    asyncio.run(main())


async def test_cancelling_loses_none_and_two_tasks_are_refused() -> None:
    watch = LineWatch()
    changes = watch.read()
    await anext(changes)
    waiting = asyncio.ensure_future(anext(changes))
    await asyncio.sleep(0)
    with pytest.raises(Busy, match="give each its own"):
        await anext(changes)
    watch.tell("away", "unplugged")
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    assert (await anext(changes)).reason == "unplugged"


async def test_a_reader_that_never_reads_holds_a_bounded_number() -> None:
    """And nothing from behind the end."""
    for ends in (LineWatch.end, lambda watch: watch.tell("ended", "unplugged")):
        watch = LineWatch()
        changes = watch.read()
        for _ in range(40):
            watch.tell("back")
            watch.tell("away", "unplugged")
        ends(watch)
        watch.tell("back")
        watch.end()
        told = await all_of(changes)
        assert len(told) == 64
        assert told[-1].state in ("away", "ended")


@pytest.mark.long
def test_without_await() -> None:
    with lidario.open_sync("sim://rplidar-s2?via=memory&fault=unplug:0.5s") as lidar:
        told: list[str] = []
        thread = threading.Thread(target=lambda: told.extend(change.state for change in lidar.line_changes()))
        thread.start()
        with pytest.raises(lidario.DeviceLost):
            for _ in lidar.scans():
                pass
        thread.join(30)
        assert told == ["connected", "ended"]
        changes = lidar.line_changes()
    assert list(changes) == []
