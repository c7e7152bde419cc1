"""What is called, in which order, for a chunk of bytes, a request, a new line: ``python -m benchmarks.walk``.

Real runs are traced with `sys.setprofile`: each call of a function of lidario, indented below its caller, by steps
of the event loop. A task that goes on after it has waited is shown once more, as ``… name``. The simulated device
is left out; so are the constructors that dataclasses make, and comprehensions. The thread that reads serial ports
is traced too; each of its polls is one step.

In memory the clock of the loop is driven, so the same lists come out each time. On a pseudo-terminal the times are
real; of the steps that differ, the commonest is shown.

`docs/architecture.md` shows an extract of these lists, which `tests/test_architecture.py` compares with a run.
"""

from __future__ import annotations

import argparse
import asyncio
import inspect
import re
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import Any, TypeAlias

import lidario
from lidario.port.thread import ReadingThread
from tests.support.loop import DrivenLoop

WAYS = ("memory", "pty")
_WARM_UP = 5
"""Scans before the trace begins: the pace must know the period, and Python has specialised its code."""
_REVOLUTIONS = 4
SECTOR_DEG = 45.0
_CAN_WAIT = inspect.CO_COROUTINE | inspect.CO_GENERATOR
_HOST_SIDE = re.compile(r"lidario\.(?!sim\.|families\.\w+\.simulated\.)")
_STEP = asyncio.Handle._run.__code__  # noqa: SLF001 - asyncio says nowhere else where a step begins
"""What an event loop calls once for each step."""
_POLL = ReadingThread.serve.__code__
_READING = ReadingThread._run.__code__  # noqa: SLF001 - the outermost function of the thread


@dataclass
class Call:
    """One call.

    Attributes:
        name: Qualified name of the function.
        depth: How many of ours called it.
        goes_on: Whether it was suspended before and goes on here.
        file: Where it stands.
    """

    name: str
    depth: int
    goes_on: bool
    file: str = ""


Step: TypeAlias = list[Call]
"""What the event loop called once, and all that was called in turn."""


@dataclass
class Walk:
    """The calls of one event.

    Attributes:
        title: What happened.
        steps: The steps of the event loop, in order; where it happened several times, the commonest.
        seen: The steps of each time that it happened.
    """

    title: str
    steps: list[Step]
    seen: list[list[Step]]

    @property
    def told(self) -> str:
        """How many calls of how many functions, in how many files."""
        calls = [call for step in self.steps for call in step]
        functions, files = {(call.file, call.name) for call in calls}, {call.file for call in calls}
        return f"{len(calls)} calls of {len(functions)} functions in {len(files)} files"


@dataclass
class _Tracer:
    """Collects calls."""

    steps: list[Step] = field(default_factory=list)
    _begins: bool = True
    _stack: list[FrameType] = field(default_factory=list)
    _kept: dict[int, FrameType] = field(default_factory=dict)

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        if event == "return" and frame in self._stack:
            del self._stack[self._stack.index(frame) :]
        if event != "call":
            return
        if frame.f_code is _STEP or frame.f_code is _POLL:
            self._begins = True
            self._stack.clear()
        if not _is_ours(frame):
            return
        if self._begins:
            self._begins = False
            self.steps.append([])
        # An exception thrown into a task goes to its innermost coroutine, without a call of those around it.
        for depth, caller in enumerate(_callers(frame)):
            if self._stack[depth : depth + 1] != [caller]:
                del self._stack[depth:]
                self._add(caller)
        if frame not in self._stack:
            self._add(frame)

    def _add(self, frame: FrameType) -> None:
        goes_on, code = id(frame) in self._kept, frame.f_code
        self.steps[-1].append(Call(code.co_qualname, len(self._stack), goes_on, code.co_filename))
        self._stack.append(frame)
        if code.co_flags & _CAN_WAIT:
            # Kept, so that no other frame gets the same id; not those of functions, which keep their locals alive.
            self._kept[id(frame)] = frame


def _callers(frame: FrameType) -> list[FrameType]:
    """Those of ours that wait for `frame` to return, outermost first."""
    found: list[FrameType] = []
    caller = frame.f_back
    while caller is not None and caller.f_code is not _STEP and caller.f_code is not _READING:
        if _is_ours(caller):
            found.append(caller)
        caller = caller.f_back
    return found[::-1]


def _is_ours(frame: FrameType) -> bool:
    if not _HOST_SIDE.match(f"{frame.f_globals.get('__name__', '')}."):
        return False
    # Comprehensions are calls in some versions of Python only.
    return not frame.f_code.co_filename.startswith("<") and "<" not in frame.f_code.co_qualname.split(".")[-1]


@contextmanager
def _polls_traced() -> Iterator[list[Step]]:
    """Trace the polls of the reading thread, where one is started meanwhile."""
    tracer = _Tracer()
    thread = 0

    def trace(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal thread
        if frame.f_code is _POLL and not thread:
            thread = threading.get_ident()
        if threading.get_ident() == thread and frame.f_code is not _READING:
            tracer(frame, event, argument)

    threading.setprofile(trace)
    try:
        yield tracer.steps
    finally:
        threading.setprofile(None)


@contextmanager
def _traced() -> Iterator[list[Step]]:
    tracer = _Tracer()
    sys.setprofile(tracer)
    try:
        yield tracer.steps
    finally:
        sys.setprofile(None)


def walked(way: str, model: str = "rplidar-s2") -> list[Walk]:
    """Trace a simulated device: chunks of its stream, a request while it is idle, one while it scans, a lost line.

    Args:
        way: ``memory`` or ``pty``.
        model: Name of the simulated device.
    """
    source = f"sim://{model}?via={way}"
    with asyncio.Runner(loop_factory=DrivenLoop if way == "memory" else None) as runner:
        found = runner.run(_walk(source))
        # Where times are real, the steps in which it is waited are too many.
        return [*found, runner.run(_comes_back(f"{source}&fault=replug:4s"))] if way == "memory" else found


async def _walk(source: str) -> list[Walk]:
    async with lidario.open_lidar(source) as lidar:
        with _traced() as idle:
            await lidar.get_health()
        with _polls_traced() as polls:
            async with lidar.scans(depth=4) as scans:
                for _ in range(_WARM_UP):
                    await anext(scans)
                with _traced() as steps:
                    for _ in range(_REVOLUTIONS):
                        await anext(scans)
                with _traced() as asked:
                    await lidar.get_health()
            async with lidar.sectors(SECTOR_DEG) as sectors:
                for _ in range(_WARM_UP):
                    await anext(sectors)
                with _traced() as in_sectors:
                    for _ in range(round(_REVOLUTIONS * 360 / SECTOR_DEG)):
                        await anext(sectors)
    thread = [[step] for step in polls if _has(step, "Inbox.read")]
    return [
        *([_of("the thread reads the port", thread)] if thread else []),
        *_chunks(steps),
        _sectors(in_sectors),
        _of("a request while no stream runs", [idle]),
        _of("a request in mid-scan", [asked]),
    ]


async def _comes_back(source: str) -> Walk:
    """From the loss of the line to the stream on the new one."""
    async with lidario.open_lidar(source, reconnect=True) as lidar, lidar.scans() as scans:
        await anext(scans)
        with _traced() as steps:
            while not lidar.stats.reconnects:
                await anext(scans)
    lost = next(at for at, step in enumerate(steps) if _has(step, "StreamControl.lose"))
    back = next(at for at, step in enumerate(steps) if at > lost and _has(step, "Running.begin"))
    return _of("a line that is lost and found again", [steps[lost : back + 1]])


def _chunks(steps: list[Step]) -> list[Walk]:
    """One step of each kind: bytes that are only read, that are parsed, that complete a revolution."""
    whole = [at for at, step in enumerate(steps) if _has(step, "Hub.publish")]
    parsed = [step for step in steps if _has(step, "Link.receive_data") and not _has(step, "Hub.publish")]
    read = [step for step in steps if _has(step, "_read") and not _has(step, "Link.receive_data")]
    found = [
        _of("a chunk that completes a revolution, and its reader", [_until_the_reader(steps, at) for at in whole])
    ]
    if parsed:
        found.insert(0, _of("a chunk in the midst of a revolution, parsed", [[step] for step in parsed]))
    if read:
        found.insert(0, _of("a chunk in the midst of a revolution, held", [[step] for step in read]))
    return found


def _sectors(steps: list[Step]) -> Walk:
    """A step that completes a sector, and no revolution."""
    alone = [at for at, step in enumerate(steps) if _has(step, "publish_sector") and not _has(step, "Hub.publish")]
    return _of("a chunk that completes a sector, and its reader", [_until_the_reader(steps, at) for at in alone])


def _of(title: str, seen: list[list[Step]]) -> Walk:
    counted = Counter(map(repr, seen))
    commonest = counted.most_common(1)[0][0]
    return Walk(title, next(steps for steps in seen if repr(steps) == commonest), seen)


def _until_the_reader(steps: list[Step], at: int) -> list[Step]:
    """From a step to the next one in which a reader got its scan; what the reader does then is left out."""
    end = next((n for n in range(at + 1, len(steps)) if steps[n][0].name == "ReaderStream.__anext__"), at)
    last = steps[end]
    done = next((n for n, call in enumerate(last) if n and not call.depth), len(last))
    return [*steps[at:end], last[:done]]


def _has(step: Step, name: str) -> bool:
    return any(call.name.endswith(name) for call in step)


def printed(walk: Walk, say: Callable[[str], object] = print) -> None:
    """Print a walk; a call that follows its like is counted, not repeated."""
    say(f"{walk.title}: {walk.told}, in {len(walk.steps)} steps of the loop")
    for number, step in enumerate(walk.steps, 1):
        lines = [f"{'  ' * call.depth}{'… ' if call.goes_on else ''}{call.name}" for call in step]
        runs: list[tuple[str, int]] = []
        for line in lines:
            if runs and runs[-1][0] == line:
                runs[-1] = (line, runs[-1][1] + 1)
            else:
                runs.append((line, 1))
        for place, (line, count) in enumerate(runs):
            times = f"  ({count} times)" if count > 1 else ""
            say(f"{f'{number}.' if not place else '':>4} {line}{times}")
    say("")


def main() -> None:
    """Print the walks of both ways, or of one."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.walk", description=__doc__.split("\n")[0])
    parser.add_argument("ways", nargs="*", default=WAYS, help=f"some of {', '.join(WAYS)}; both by default")
    parser.add_argument("--model", default="rplidar-s2", help="a simulated device, as in sim://MODEL")
    options = parser.parse_args()
    for way in options.ways:
        print(f"== {options.model}, via {way} ==\n")
        for walk in walked(way, options.model):
            printed(walk)


if __name__ == "__main__":
    main()
