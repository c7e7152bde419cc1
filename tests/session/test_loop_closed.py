"""A program may end at any moment, and its event loop is closed at once: the device is still all the same.

In these tests nothing waits after the cancellation, so what a timer would do later is not done any more. Also while
a session comes back: no task goes on, and a device that was reached is still.
"""

import asyncio
import gc
import math
from collections.abc import Awaitable, Callable
from contextlib import closing, suppress
from typing import Any

import pytest

from lidario import Lidar, open_lidar
from tests.session.test_two_tasks import Scene, Work, ask_while_scanning, leave, stop
from tests.support.cable import Cable, cable_to
from tests.support.devices import SWITCHED, Rig, both_families, is_off, leave_streaming, left_still, make_rig, names
from tests.support.discards import all_obeyed
from tests.support.loop import START, DrivenLoop, unless_unfinished
from tests.support.simulated_rplidar import MOTOR_600
from tests.support.speeds import Written, serial_in_memory

Interrupt = Callable[[DrivenLoop, "asyncio.Task[None]"], None]
TIMES = 4
"""Cancellations in as many turns of the loop: `asyncio.run` adds one when a second Ctrl-C ends it."""


def run_and_close(
    rig: Rig,
    work: Callable[[Lidar], Awaitable[None]],
    at: int,
    what: Interrupt,
    monkeypatch: pytest.MonkeyPatch,
    *,
    plain: bool = False,
    reconnect: bool = False,
    by_hand: bool = False,
) -> int:
    """Run `work`, interrupt it when the loop has gone round `at` times, close the loop; the turns that it went.

    Where `at` is 0, `what` is called in each turn, and decides by itself.
    A plain loop cancels nothing when KeyboardInterrupt comes out of it: `loop.run_until_complete`, Ctrl-C,
    `loop.close`. The session is garbage then, also where a reader waited; `by_hand`, its coroutine is closed first.
    """
    loop = DrivenLoop()
    monkeypatch.setattr("lidario.port.port.time.sleep", loop.block)

    async def main() -> None:
        task = asyncio.current_task()
        assert task is not None
        loop.at_turn = lambda turn: (
            what(loop, task) if not at or at <= turn < at + (1 if plain else TIMES) else None
        )
        async with rig.open(reconnect=reconnect) as lidar:
            await work(lidar)

    if plain:
        loop.set_exception_handler(unless_unfinished)
        coroutine = main()
        with suppress(KeyboardInterrupt), closing(loop):
            loop.run_until_complete(coroutine)
        if by_hand:
            coroutine.close()
        del coroutine
        turns = loop.turns
    else:
        with asyncio.Runner(loop_factory=lambda: loop) as runner:
            with suppress(asyncio.CancelledError, KeyboardInterrupt):
                runner.run(main())
            loop.at_turn = None
            turns = loop.turns
    gc.collect()
    return turns


def cancel_again_and_again(_: DrivenLoop, task: asyncio.Task[None]) -> None:
    task.cancel()


def interrupt(loop: DrivenLoop, _: asyncio.Task[None]) -> None:
    """As a second Ctrl-C: it comes out of the loop itself, and the runner then cancels what is left."""
    loop.at_turn = None
    raise KeyboardInterrupt


def never(_: DrivenLoop, task: asyncio.Task[None]) -> None:
    pass


WAYS = {"cancelled": cancel_again_and_again, "Ctrl-C": interrupt, "a plain loop": interrupt}


@pytest.mark.usefixtures("quick_collection")
@pytest.mark.filterwarnings("ignore:coroutine .* was never awaited")  # a task that the loop had not begun yet
@both_families
@pytest.mark.parametrize("work", [ask_while_scanning, leave, stop])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.exhaustive("points", sample=[4], full=[20])
def test_ended_at_every_turn_of_the_loop(
    family: str, work: Work, way: str, points: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(rig: Rig, at: int, what: Interrupt) -> int:
        plain = way == "a plain loop"
        return run_and_close(rig, lambda lidar: Scene(rig, lidar).work(work), at, what, monkeypatch, plain=plain)

    turns = run(make_rig(family), 1, never)
    for at in range(2, turns, max(1, turns // points)):
        rig = make_rig(family)
        run(rig, at, WAYS[way])
        if any("scan" in name for name in names(rig)):
            assert left_still(rig), (at, names(rig)[-4:])
        all_obeyed([rig.device])


async def nothing(_: Lidar) -> None:
    pass


@pytest.mark.long
@pytest.mark.usefixtures("quick_collection")
@pytest.mark.parametrize("kind", [*SWITCHED, "hlds", "ldrobot-ld14p"])
def test_ended_while_one_that_streams_is_opened(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also before it has said what it is, where it is not written to before either."""

    def streaming() -> Rig:
        rig = make_rig(kind)
        leave_streaming(rig.device, round(START * 1e9))
        return rig

    turns = run_and_close(streaming(), nothing, 1, never, monkeypatch, plain=True)
    for at in range(2, turns, max(1, turns // 20)):
        rig = streaming()
        run_and_close(rig, nothing, at, interrupt, monkeypatch, plain=True)
        assert left_still(rig), (at, names(rig)[-4:])


by_both = pytest.mark.parametrize("by_hand", [False, True])


def search_until(
    rig: Rig, heard: bytes, ends: Callable[[DrivenLoop], bool], by_hand: bool, monkeypatch: pytest.MonkeyPatch
) -> Written:
    """Search one that has heard this before, at every speed, and interrupt that; what was written."""
    rig.device.receive(heard, round(START * 1e9))
    assert rig.device.motor_on is (heard == MOTOR_600)
    rig.device.log.clear()
    written = serial_in_memory(monkeypatch, only=rig.device)
    monkeypatch.setattr(Rig, "open", lambda rig, **_: open_lidar("only"))

    def end(loop: DrivenLoop, task: asyncio.Task[None]) -> None:
        if ends(loop):
            interrupt(loop, task)

    run_and_close(rig, nothing, 0, end, monkeypatch, plain=True, by_hand=by_hand)
    return written


@pytest.mark.usefixtures("quick_collection")
@by_both
@pytest.mark.exhaustive(
    ("ended_after_s", "mute_s"), sample=[(0.5, math.inf), (2.0, math.inf), (4.0, math.inf), (1.1, 1.0)]
)
@pytest.mark.parametrize("model", ["ldrobot-ld14p", "hlds-lds01"])
def test_ended_while_others_are_asked_and_one_was_started_before(
    model: str, ended_after_s: float, mute_s: float, by_hand: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It runs at another speed, and what is asked just now is stopped at its own; or it is just being heard."""
    rig = make_rig(model)
    stop = bytes.fromhex("54A104000000004A") if model == "ldrobot-ld14p" else b"e"

    def ends(loop: DrivenLoop) -> bool:
        rig.device.mute = loop.time() <= START + mute_s
        return loop.time() > START + ended_after_s

    written = search_until(rig, stop, ends, by_hand, monkeypatch)
    assert names(rig).count("start") > 0
    assert not rig.device.motor_on
    assert written.came_whole(stop)


@pytest.mark.usefixtures("quick_collection")
@by_both
def test_ended_while_one_is_asked_whose_motor_was_left_on(by_hand: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is stopped at its own speed, also where others were started at another one before."""
    rig = make_rig("rplidar-c1")
    written = search_until(rig, MOTOR_600, lambda _: bool(rig.device.log), by_hand, monkeypatch)
    assert left_still(rig), names(rig)
    assert 230_400 in {speed for speed, _ in written[-3:]}


OUT_S = 0.3


def ended_at(family: str, at: int, what: Interrupt, monkeypatch: pytest.MonkeyPatch) -> tuple[int, int, Rig, Cable]:
    """End a program in that turn of the loop; the turn in which its device was unplugged, and the last one."""
    rig = make_rig(family)
    rig.device.boot_s = 0.3
    pulled = 0

    with cable_to(rig) as cable:

        async def work(lidar: Lidar) -> None:
            nonlocal pulled
            loop: Any = asyncio.get_running_loop()
            async with lidar.scans() as stream:
                await anext(stream)
                pulled = loop.turns
                cable.pull()
                loop.call_later(OUT_S, cable.plug)
                while not lidar.stats.reconnects:
                    await anext(stream)

        turns = run_and_close(rig, work, at, what, monkeypatch, reconnect=True)
    return pulled, turns, rig, cable


@both_families
@pytest.mark.parametrize("what", [cancel_again_and_again, interrupt])
@pytest.mark.exhaustive("points", sample=[2], full=[12])
def test_ended_at_every_turn_of_coming_back(
    family: str, what: Interrupt, points: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, turns, _, _ = ended_at(family, 1, never, monkeypatch)
    for at in range(first + 1, turns, max(1, (turns - first) // points)):
        _, _, rig, cable = ended_at(family, at, what, monkeypatch)
        # While the cable is out nobody can stop a device that has power of its own; this one has none then.
        if cable.device is not None:
            assert is_off(rig.device), at
