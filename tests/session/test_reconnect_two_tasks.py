"""Two tasks at once while a session comes back: one reads, the other acts, at steps of the event loop.

Task A reads while the device is unplugged for a moment, restarts, or stops to protect itself. When the loop has
gone round so many times, task B stops, closes, cancels A, starts a stream of its own, or asks. After each:

* both have ended, with a result or with the one error that is documented for it;
* the device scans when a stream is wanted, and hands out scans; it is still when none is;
* after the session was closed no timer is left (tasks, threads and descriptors: `tests.conftest`).
"""

import asyncio
import gc
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import cache, partial
from itertools import product

import pytest

from lidario import DeviceLost, Lidar, SessionClosed
from tests.session.test_reconnect import MODES
from tests.session.test_two_tasks import Scene, as_it_should_be, b_cancels, b_closes, b_starts, b_stops, both
from tests.support.cable import Cable, cable_to
from tests.support.devices import FAMILIES, is_off, make_rig
from tests.support.discards import all_obeyed
from tests.support.loop import at_each, driven_loop, now_ns, run_driven

pytestmark = [
    pytest.mark.discards("a device that restarts or protects itself gives no sign of it"),
    pytest.mark.usefixtures("quick_collection"),
]

LONGEST_S = 20.0
OUT_S = 0.3
AGAIN_S = 1.5
GOLDEN = 0.618
"""Multiples of this, without their whole parts, are spread evenly."""
Trouble = Callable[[Scene, Cable], None]


def is_unplugged(scene: Scene, cable: Cable) -> None:
    cable.pull()
    asyncio.get_running_loop().call_later(OUT_S, cable.plug)


def restarts(scene: Scene, cable: Cable) -> None:
    scene.rig.device.reboot(now_ns())


def protects_itself(scene: Scene, cable: Cable) -> None:
    scene.rig.device.protection_stop(0x8001)


async def b_asks(scene: Scene) -> None:
    with suppress(DeviceLost):
        await scene.lidar.get_info()


async def b_sets(scene: Scene) -> None:
    with suppress(DeviceLost):
        await scene.lidar.set_scan_frequency(8.0, verify=False)


TROUBLES: tuple[Trouble, ...] = (is_unplugged, restarts, protects_itself)
B: tuple[Callable[[Scene], Awaitable[object]], ...] = (b_stops, b_closes, b_cancels, b_starts, b_asks, b_sets)


async def cell(family: str, trouble: Trouble, b: Callable[[Scene], Awaitable[object]] | None, step: int) -> int:
    """One meeting of the two; with no B, how often the loop goes round while A runs."""
    rig = make_rig(family)
    rig.device.boot_s = 0.5
    loop = driven_loop()
    with cable_to(rig) as cable:
        lidar = await rig.open(reconnect=True)
        scene = Scene(rig, lidar)
        stream = scene.stream(MODES[family])
        await anext(stream)

        async def a(scene: Scene) -> None:
            trouble(scene, cable)
            # A question that is asked while it boots may be what notices that it is back.
            began = loop.time()
            while not lidar.stats.reconnects and loop.time() < began + AGAIN_S:
                await anext(stream)

        before = loop.turns
        if b is None:
            await a(scene)
        else:
            await both(scene, a, b, step)
        turns = loop.turns - before
        await is_back(lidar)
        await as_it_should_be(scene, lambda rig: is_off(rig.device))
        await lidar.close()
        await asyncio.sleep(2.0)
        gc.collect()
        assert is_off(rig.device)
        assert not loop.timers
        if trouble is is_unplugged:
            all_obeyed([rig.device])
    return turns


async def is_back(lidar: Lidar) -> None:
    """Wait until the session has its device again, or was closed."""
    with suppress(SessionClosed):
        await lidar.__aenter__()
        async with asyncio.timeout(LONGEST_S):
            while not lidar.is_connected:
                await asyncio.sleep(0.1)


@cache
def turns_of(family: str, trouble: Trouble) -> int:
    """How many turns of the loop coming back takes where nobody else does anything."""
    return run_driven(lambda: cell(family, trouble, None, 0))


PAIRS = list(product(TROUBLES, B))


@pytest.mark.exhaustive("points", sample=[1], full=[12])
@pytest.mark.exhaustive(
    "what",
    sample=[(*pair, FAMILIES[number // 2 % len(FAMILIES)]) for number, pair in enumerate(PAIRS)],
    full=[(*pair, family) for pair in PAIRS for family in FAMILIES],
)
def test_two_tasks_while_it_comes_back(
    what: tuple[Trouble, Callable[[Scene], Awaitable[object]], str], points: int
) -> None:
    trouble, b, family = what
    turns = turns_of(family, trouble)
    stride = max(1, turns // points)
    # Each pair begins at another step, so that also a sample goes through the whole of coming back.
    number = TROUBLES.index(trouble) * len(B) + B.index(b)
    steps = range(1 + round(stride * (GOLDEN * number % 1.0)), turns + 2, stride)
    at_each(steps, partial(cell, family, trouble, b), f"{trouble.__name__} x {b.__name__}")
