"""Programs on a pseudo-terminal are ended at random moments at true pace: the device is still after each.

`test_cancellation` goes through every step of the loop on a driven clock; here the threads, the kernel and the
clock are real. Programs and moments are drawn from a seed.
"""

import asyncio
import random
import signal
import time
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from typing import Any

import anyio
import pytest
import uvloop

import lidario
from lidario import Lidar, LidarError, Unsupported
from lidario.sim.serve import PtyServer
from tests.cli.processes import served
from tests.session.test_many_tasks import leave_at_once, read
from tests.support.children import forget, is_still, requests, until
from tests.support.leaks import leaves_nothing

LONGEST_S = 0.3
BUSY_S, BOOTING_S = 0.02, 0.6
"""After a STOP the device hears nothing for 10 ms, after a RESET for 500, after a query until it has responded. A
program that was cancelled twice does not wait for that, and the next one cannot know of it."""
NO_MISTAKE = ("within ", "while the response to ", "still booting", "unknown to this ")
"""Why the device discards what comes too soon, which `test_cancellation` shows in driven time, and what it does not
know."""
Action = Callable[[Lidar], Awaitable[object]]
End = Callable[[Awaitable[None], float], Coroutine[Any, Any, None]]


async def ask_beside_a_reader(lidar: Lidar) -> None:
    await asyncio.gather(lidar.scan(), lidar.get_health())


async def stop_beside_a_reader(lidar: Lidar) -> None:
    with suppress(LidarError):
        await asyncio.gather(lidar.scan(), lidar.stop())


async def change_speed(lidar: Lidar) -> None:
    with suppress(Unsupported):  # an A1
        await lidar.set_scan_frequency(9.0, verify=False)


ACTIONS: tuple[Action, ...] = (
    Lidar.scan, Lidar.stop, Lidar.get_health, Lidar.get_modes, read, leave_at_once, ask_beside_a_reader,
    stop_beside_a_reader, change_speed, Lidar.reset,
)  # fmt: skip


async def program(path: str, family: str, dice: random.Random) -> None:
    async with lidario.open_lidar(path, family=family) as lidar:
        while True:
            await dice.choice(ACTIONS)(lidar)


async def cancelled(work: Awaitable[None], after: float, times: int = 1) -> None:
    task = asyncio.ensure_future(work)
    for number in range(times):
        asyncio.get_running_loop().call_later(after + number * 0.0005, task.cancel)
    with pytest.raises(asyncio.CancelledError):
        await task


async def cancelled_twice(work: Awaitable[None], after: float) -> None:
    """The loop is closed as soon as the task has ended."""
    await cancelled(work, after, 2)


async def timed_out(work: Awaitable[None], after: float) -> None:
    with anyio.move_on_after(after) as scope:
        await work
    assert scope.cancelled_caught


async def interrupted(work: Awaitable[None], after: float) -> None:
    asyncio.get_running_loop().call_later(after, signal.raise_signal, signal.SIGINT)
    await work


async def interrupted_twice(work: Awaitable[None], after: float) -> None:
    asyncio.get_running_loop().call_later(after + 0.0005, signal.raise_signal, signal.SIGINT)
    await interrupted(work, after)


ENDS: tuple[End, ...] = (cancelled, cancelled_twice, timed_out, interrupted, interrupted_twice)


def end_at_random(server: PtyServer, family: str, seed: int) -> None:
    """Run a random program, end it in a random way at a random moment, and wait until the device is still."""
    dice = random.Random(seed)
    end, after = dice.choice(ENDS), dice.uniform(0.0, LONGEST_S)
    loop = dice.choice([asyncio.new_event_loop, uvloop.new_event_loop])
    told = f"seed {seed}: {end.__name__} after {after:.4f} s on {loop.__module__}"
    forget(server)
    with leaves_nothing(), suppress(KeyboardInterrupt), asyncio.Runner(loop_factory=loop) as runner:
        runner.run(end(program(server.path, family, dice), after))
    until(lambda: is_still(server), lambda: (told, requests(server)[-5:]))
    # What came too soon for it, the host may have sent in time: a busy machine lets the device see a STOP late, or
    # a question together with the stop requests that were written a tenth of a second after it.
    lost = [each for each in requests(server) if not each.obeyed and not each.why.startswith(NO_MISTAKE)]
    assert not lost, (told, lost)
    until_it_listens(server)


def until_it_listens(server: PtyServer) -> None:
    """Wait until the device listens again, whatever it was asked last."""
    done = [each.at_ns * 1e-9 + (BOOTING_S if each.name == "reset" else BUSY_S) for each in requests(server)]
    time.sleep(max(0.0, max(done, default=0.0) - time.monotonic()))


@pytest.mark.long
@pytest.mark.parametrize("model", ["rplidar-s2", "ydlidar-4ros", "rplidar-a1"])
def test_ended_at_a_random_moment(model: str, rounds: int) -> None:
    with served(model) as server:
        with server.lock:
            server.device.boot_s = 0.05  # type: ignore[attr-defined]
        for seed in range(rounds):
            end_at_random(server, model.partition("-")[0], seed)
