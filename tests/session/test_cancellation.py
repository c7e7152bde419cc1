"""Cancelling at every step of the event loop leaves laser and motor off, the port closed, and no task behind.

Rather than one test for each await that can hang, each scenario is run once to count how often the loop goes
round, and then again and again, cancelled a little later each time: natively, natively twice, and by a cancel
scope of anyio. Whatever the session was waiting for at that moment, the strict device must have heard STOP where
it could hear it.

Also while it is not known yet what the device is: where its family is not named, and it is searched for.
"""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from itertools import product

import anyio
import pytest

from lidario import LidarError, open_lidar
from tests.session.test_two_tasks import Scene, Work, ask_while_scanning, change_mode, read, reset, set_speed, stop
from tests.support.devices import (
    EVERY_KIND,
    FAMILIES,
    OTHERS,
    SWITCHED,
    Rig,
    in_turns,
    leave_streaming,
    left_still,
    make_rig,
)
from tests.support.discards import all_obeyed
from tests.support.loop import at_each, driven_loop, now_ns, turns_of
from tests.support.speeds import serial_in_memory

Scenario = Callable[[Rig], Awaitable[None]]


async def open_and_close(rig: Rig) -> None:
    async with rig.open():
        pass


async def open_a_faulty_device(rig: Rig) -> None:
    rig.device.faults_cleared_by_reset = False
    rig.device.protection_stop(3)
    with suppress(LidarError):
        await open_and_close(rig)


async def open_a_mute_device(rig: Rig) -> None:
    rig.device.mute = True
    with suppress(LidarError):
        await open_and_close(rig)


async def open_a_streaming_device(rig: Rig) -> None:
    leave_streaming(rig.device, now_ns())
    await open_and_close(rig)


async def search(rig: Rig) -> None:
    """At every speed, on a line whose opening clears DTR, as that of a serial port does."""
    with pytest.MonkeyPatch.context() as patch:
        serial_in_memory(patch, unknown=rig.device)
        async with open_lidar("unknown"):
            pass


async def search_a_streaming_device(rig: Rig) -> None:
    leave_streaming(rig.device, now_ns())
    await search(rig)


async def wait_for_a_late_scan(rig: Rig) -> None:
    rig.device.spin_up_s = 1.0
    async with rig.open() as lidar:
        await lidar.scan()


async def wait_for_an_answer(rig: Rig) -> None:
    async with rig.read() as (lidar, _):
        rig.device.garble_responses = 1
        await lidar.get_info()


def used(work: Work) -> Scenario:
    """What another test does in two tasks, in a session of its own."""

    async def use(rig: Rig) -> None:
        async with rig.open() as lidar:
            await Scene(rig, lidar).work(work)

    use.__name__ = work.__name__
    return use


SCENARIOS: tuple[Scenario, ...] = (
    open_and_close, open_a_faulty_device, open_a_mute_device, open_a_streaming_device, wait_for_a_late_scan,
    wait_for_an_answer, *map(used, (read, ask_while_scanning, set_speed, change_mode, reset, stop)),
)  # fmt: skip
SEARCHES: tuple[Scenario, ...] = (search, search_a_streaming_device)
SEARCHED = (*EVERY_KIND, "ydlidar-x2", "ydlidar-x4", "ldrobot-ld14p")
"""Of those with another motor or speed one each. DTR stops an A1 and starts an X2."""


async def cancelled_at(scenario: Scenario, family: str, how: str, turn: int) -> None:
    """Run `scenario`, cancel it when the loop has gone round `turn` times, and look at what is left."""
    rig, loop = make_rig(family), driven_loop()
    scope = anyio.CancelScope()

    async def inside() -> None:
        with scope:
            await scenario(rig)

    task, cancelled = asyncio.ensure_future(inside()), False

    def cancel() -> None:
        nonlocal cancelled
        if how == "scope":
            scope.cancel()
        else:
            cancelled = task.cancel()
        if how == "twice":
            loop.after(2, task.cancel)

    loop.after(turn, cancel)
    with suppress(asyncio.CancelledError):
        await task
    assert task.cancelled() or not cancelled  # a cancellation is raised, however late
    # What was written is on its way even if nobody waited for it.
    await asyncio.sleep(5.0)
    if rig.device.log or scenario in SEARCHES:
        assert left_still(rig), [(each.name, each.obeyed, each.why) for each in rig.device.log][-5:]
    all_obeyed([rig.device])


WAYS = ("once", "twice", "scope")
THOROUGH = (*FAMILIES, *SWITCHED)


STREAMING = [(open_a_streaming_device, "once", kind) for kind in ("hlds", "hlds-lds01-2016", "ldrobot-ld14p")]
"""They are stopped also before enough was heard of them to know what they are."""


@pytest.mark.exhaustive(
    "what",
    sample=[*in_turns(SCENARIOS, WAYS, EVERY_KIND), *STREAMING],
    full=[*product(SCENARIOS, WAYS, FAMILIES), *in_turns(SCENARIOS, WAYS, OTHERS), *STREAMING],
)
@pytest.mark.exhaustive("points", sample=[4], full=[12])
def test_cancelled_anywhere_the_device_is_left_still(what: tuple[Scenario, str, str], points: int) -> None:
    scenario, how, family = what
    turns = turns_of(lambda: scenario(make_rig(family)))
    # Other families go other ways only where nothing is written: a quarter of the points shows as much.
    every = points if family in THOROUGH or what in STREAMING else -(-points // 4)
    stride = max(1, turns // every)
    at_each(range(1, turns + 1, stride), partial(cancelled_at, scenario, family, how), "cancelled")


@pytest.mark.long
@pytest.mark.exhaustive(
    "what",
    sample=[(SEARCHES[at % 2], "twice", kind) for at, kind in enumerate(SEARCHED)],
    full=[*product(SEARCHES, WAYS, SEARCHED)],
)
@pytest.mark.exhaustive("points", sample=[5], full=[60])
def test_a_search_that_is_cancelled_leaves_the_device_still(what: tuple[Scenario, str, str], points: int) -> None:
    """From the moment on at which the port is open."""
    scenario, how, kind = what
    turns = turns_of(lambda: scenario(make_rig(kind)))
    # Most is decided in the first turns, while it is listened to and each family is asked shortly.
    chosen = sorted({*range(2, 2 + points), *range(2, turns + 1, max(1, turns // points))})
    at_each(chosen, partial(cancelled_at, scenario, kind, how), "cancelled")
