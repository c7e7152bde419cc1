"""Two tasks at once: what one does, times what the other does to it, times every step of the event loop.

Task A opens, starts a stream, reads, asks, sets the speed, changes the mode, resets, leaves, or closes. When
the loop has gone round so many times, task B stops, closes, cancels A, starts a stream of its own, or asks. After
each:

* both have ended, with a result or with the one error that is documented for it;
* the device scans when a stream is wanted, and hands out scans; it is still when none is;
* after the session was closed it is still, and no timer is left (tasks, threads and descriptors: `tests.conftest`);
* the strict device has discarded no request (`tests.support.discards` asserts that in every test).

Where the device falls silent at that moment, nothing but task B ends what A waits for: then it ends at once.

The loop is driven, so a step is a step, whatever the machine is doing.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import product

import pytest

from lidario import Lidar, LidarError, LocalProtocolError, ScanStream, SessionClosed, StreamFailed, Unsupported
from tests.support.devices import EVERY_KIND, FAMILIES, OTHERS, SWITCHED, Rig, in_turns, left_still, make_rig, some
from tests.support.discards import all_obeyed
from tests.support.loop import at_each, driven_loop, run_driven

SAMPLE = 2
"""Steps tried of each cell in a sample; every twelfth with ``--exhaustive``, all of them with ``--every-step``."""
SAMPLE_OF_OTHERS = 1
"""The same of a family whose devices hear nothing: no step of theirs waits for a response."""
LONGEST_S = 20.0
"""No call takes longer: the longest are a speed that is not reached (10 s) and a boot (8 s)."""
AT_ONCE_S = 0.15
"""No call takes longer to be stopped, closed or cancelled. The stop requests wait for a response for 0.1 s."""


@dataclass
class Scene:
    """What both tasks see.

    Attributes:
        streams: Every stream that was made; they are held until the end, so that none is left unnoticed.
    """

    rig: Rig
    lidar: Lidar
    streams: list[ScanStream] = field(default_factory=list)

    def stream(self, mode: str | None = None) -> ScanStream:
        self.streams.append(self.lidar.scans(mode))
        return self.streams[-1]

    async def work(self, work: "Work") -> None:
        """Do that, and leave the streams."""
        try:
            await work(self)
        finally:
            for stream in self.streams:
                await stream.aclose()

    async def gives_scans(self) -> bool:
        """Whether any stream goes on. One that has ended, or was left, gives at once what it holds, and no more."""
        loop, going_on = asyncio.get_running_loop(), False
        for stream in self.streams:
            began = loop.time()
            try:
                async with asyncio.timeout(LONGEST_S):
                    # A scan may be held already; the one after the next is of now.
                    await some(stream, 3)
                going_on = True
            except (StopAsyncIteration, LidarError):
                assert loop.time() == began
        return going_on


Work = Callable[[Scene], Awaitable[object]]


async def start(scene: Scene) -> None:
    await anext(scene.stream())


async def read(scene: Scene) -> None:
    stream = scene.stream()
    await some(stream, 3)


async def ask(scene: Scene) -> None:
    await scene.lidar.get_health()


async def ask_while_scanning(scene: Scene) -> None:
    await anext(scene.stream())
    with suppress(Unsupported):
        await scene.lidar.get_scan_frequency()


async def set_speed(scene: Scene) -> None:
    await anext(scene.stream())
    with suppress(Unsupported):
        await scene.lidar.set_scan_frequency(8.0)


async def change_mode(scene: Scene) -> None:
    await scene.lidar.scan()
    await scene.lidar.scan("Standard")


async def reset(scene: Scene) -> None:
    await anext(scene.stream())
    with suppress(Unsupported):
        await scene.lidar.reset()


async def leave(scene: Scene) -> None:
    async with scene.stream() as stream:
        await anext(stream)


async def stop(scene: Scene) -> None:
    await anext(scene.stream())
    await scene.lidar.stop()


async def close(scene: Scene) -> None:
    await anext(scene.stream())
    await scene.lidar.close()


async def b_stops(scene: Scene) -> None:
    await scene.lidar.stop()


async def b_closes(scene: Scene) -> None:
    await scene.lidar.close()


async def b_starts(scene: Scene) -> None:
    await anext(scene.stream())


async def b_asks(scene: Scene) -> None:
    await scene.lidar.get_info()


async def b_cancels(scene: Scene) -> None:
    """Nothing but cancelling A, which `act` does."""


A: tuple[Work, ...] = (start, read, ask, ask_while_scanning, set_speed, change_mode, reset, leave, stop, close)
READERS: tuple[Work, ...] = (start, read, leave, change_mode)
"""What a stop ends; a question goes on."""
B: tuple[Work, ...] = (b_stops, b_closes, b_cancels, b_starts, b_asks)


def may_end_with(a: Work, b: Work, error: BaseException, *, of_b: bool) -> bool:
    """Whether an error is documented for that call while the other task does that."""
    if isinstance(error, SessionClosed):
        return b is b_closes or a is close
    if isinstance(error, StopAsyncIteration):
        return b is b_stops or a is stop
    if isinstance(error, asyncio.CancelledError):
        return b is b_cancels and not of_b
    # `scan()` while another task stops, and a mode that does not go with that of the other reader.
    return isinstance(error, LocalProtocolError) and a is change_mode and b in (b_stops, b_starts)


async def both(scene: Scene, a: Work, b: Work, step: int, *, silent: bool = False) -> float:
    """Run A, and B when the loop has gone round `step` times, as the device falls silent or not.

    Returns the seconds from the begin of B to the end of A.
    """
    loop = driven_loop()
    task_a = asyncio.ensure_future(a(scene))
    tasks = {task_a}
    times: list[float] = []
    ended: list[float] = []
    task_a.add_done_callback(lambda _: ended.append(loop.time()))

    def act() -> None:
        scene.rig.device.mute = silent
        times.append(loop.time())
        tasks.add(asyncio.ensure_future(b(scene)))
        if b is b_cancels:
            task_a.cancel()

    loop.after(step, act)
    while not times:
        await asyncio.sleep(0.001)
    done, waiting = await asyncio.wait(tasks, timeout=LONGEST_S)
    assert not waiting, f"still waiting: {waiting}"
    for task in done:
        error = asyncio.CancelledError() if task.cancelled() else task.exception()
        if silent and isinstance(error, StreamFailed) and task is not task_a:
            continue  # it was not seen to stop
        if error is not None and not may_end_with(a, b, error, of_b=task is not task_a):
            raise AssertionError(f"{task} ended with {error!r}") from error
    return ended[0] - times[0]


async def as_it_should_be(scene: Scene, still: Callable[[Rig], bool] = left_still) -> None:
    """The device scans where a stream is wanted; else it is still, some time after the last reader has gone."""
    lidar, device = scene.lidar, scene.rig.device
    was_scanning = lidar.is_scanning
    if await scene.gives_scans():
        assert was_scanning
        assert device.scanning
    else:
        await asyncio.sleep(3.0)
        assert not lidar.is_scanning
        assert still(scene.rig), [(each.name, each.why) for each in device.log][-6:]


async def cell(family: str, a: Work, b: Work, step: int, *, silent: bool) -> None:
    rig = make_rig(family)
    lidar = await rig.open()
    scene = Scene(rig, lidar)
    took = await both(scene, a, b, step, silent=silent)
    if silent or (b is b_stops and a in READERS):
        assert took < AT_ONCE_S, f"it waited for {took:.3f} s"
    if not silent:
        await as_it_should_be(scene)
    await lidar.close()
    await asyncio.sleep(0)
    assert left_still(rig)
    all_obeyed([rig.device])
    assert silent or all(not each.remark for each in rig.device.log)
    assert not driven_loop().timers


def steps_of(family: str, a: Work) -> int:
    """How often the loop goes round while A runs undisturbed."""

    async def alone() -> int:
        rig = make_rig(family)
        lidar = await rig.open()
        loop = driven_loop()
        before = loop.turns
        await a(Scene(rig, lidar))
        steps = loop.turns - before
        await lidar.close()
        return steps

    return run_driven(alone)


def chosen(steps: int, stride: int, sample: int = SAMPLE) -> Iterator[int]:
    """Every `stride`-th step; `sample` of them where that is 0."""
    stride = stride or max(1, steps // sample)
    yield from range(1 + stride // 3, steps + 2, stride)


@pytest.fixture
def every_step(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--every-step"))


@pytest.mark.exhaustive("stride", sample=[0], full=[12])
@pytest.mark.exhaustive(
    "who", sample=in_turns(A, B, EVERY_KIND), full=[*product(A, B, FAMILIES), *in_turns(A, B, OTHERS)]
)
def test_two_tasks(who: tuple[Work, Work, str], stride: int, every_step: bool) -> None:
    a, b, family = who
    two_tasks(family, a, b, 1 if every_step else stride)


def two_tasks(family: str, a: Work, b: Work, stride: int, *, silent: bool = False) -> None:
    steps = chosen(steps_of(family, a), stride, SAMPLE if family in (*FAMILIES, *SWITCHED) else SAMPLE_OF_OTHERS)
    at_each(steps, lambda step: cell(family, a, b, step, silent=silent), f"{a.__name__} x {b.__name__}")


@pytest.mark.parametrize("family", FAMILIES)
def test_a_stream_is_stopped_while_it_is_started(family: str) -> None:
    two_tasks(family, start, b_stops, 4)


@pytest.mark.long
@pytest.mark.exhaustive("stride", sample=[0], full=[12])
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("b", [b_stops, b_closes, b_cancels], ids=lambda work: work.__name__)
def test_the_other_ends_what_a_silent_device_does_not(family: str, b: Work, stride: int, every_step: bool) -> None:
    for a in READERS if b is b_stops else A:
        two_tasks(family, a, b, 1 if every_step else stride, silent=True)


async def test_one_that_the_other_task_has_stopped_is_woken_again_for_the_next_question() -> None:
    """It hears nothing while DTR is cleared, as the other task has left it behind a question without a response."""
    async with (rig := make_rig("ydlidar-x4")).open() as lidar:
        rig.device.mute = True
        asking = asyncio.ensure_future(lidar.get_health())
        await asyncio.sleep(0.1)
        stopping = asyncio.ensure_future(lidar.stop())
        await asyncio.sleep(1.2)
        assert left_still(rig)
        rig.device.mute = False
        assert (await asking).ok
        await stopping
        await asyncio.sleep(3.0)
        assert left_still(rig)
