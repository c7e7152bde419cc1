"""Ctrl-C is raised wherever the interpreter is, in the midst of opening and of closing: the device is left still.

A program that is ended by Ctrl-C runs no `await` any more where the exception passes its event loop. So whatever
was written by then, a finalizer must know the device, and when it listens again.
"""

import asyncio
import gc
import sys
from collections.abc import Callable, Coroutine
from contextlib import closing, suppress
from itertools import count
from typing import Any

import pytest

from tests.support.devices import FAMILIES, SWITCHED, both_families, leave_streaming, left_still, make_rig, names
from tests.support.interrupt import CtrlC, no_collection
from tests.support.loop import DrivenLoop, now_ns

pytestmark = [
    pytest.mark.discards("where Ctrl-C comes right after a request was written, what follows may come too early"),
    pytest.mark.usefixtures("quick_collection"),
]


def run(main: Callable[[], Coroutine[Any, Any, None]], patch: pytest.MonkeyPatch, *, orderly: bool = True) -> None:
    """Run a program that Ctrl-C may end, by `asyncio.run` or on a loop that is closed at once."""
    loop, before = DrivenLoop(), sys.gettrace()
    patch.setattr("lidario.port.port.time.sleep", loop.block)
    try:
        with suppress(KeyboardInterrupt):
            if orderly:
                with asyncio.Runner(loop_factory=lambda: loop) as runner:
                    runner.run(main())
            else:
                with closing(loop):
                    loop.run_until_complete(main())
    finally:
        sys.settrace(before)
        gc.collect()


@pytest.mark.long
@both_families
@pytest.mark.exhaustive("stride", sample=[11], full=[1])
def test_ctrl_c_at_every_line_of_close(family: str, stride: int, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        lidar = await rig.open()
        stream = lidar.scans()
        await anext(stream)
        with no_collection(), ctrl_c:
            await lidar.close()

    for line in count(0, stride):
        rig, ctrl_c = make_rig(family), CtrlC(line, "/lidario/session/")
        run(main, monkeypatch)
        assert left_still(rig), (line, names(rig)[-4:])
        if not ctrl_c.place:
            break
    assert line + stride > 30


@pytest.mark.long
@pytest.mark.parametrize("family", [*FAMILIES, *SWITCHED])
@pytest.mark.exhaustive("ending", sample=[("orderly", 37), ("at once", 37)], full=[("orderly", 5), ("at once", 3)])
def test_ctrl_c_at_every_line_of_opening(
    family: str, ending: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device that still streams. A loop that `asyncio.run` ends has more time to stop it."""

    async def main() -> None:
        leave_streaming(rig.device, now_ns())
        with no_collection(), ctrl_c:
            lidar = await rig.open()
        await lidar.close()

    way, stride = ending
    moving = []
    for line in count(stride // 2, stride):
        rig, ctrl_c = make_rig(family), CtrlC(line, "/lidario/session/", "/lidario/port/")
        run(main, monkeypatch, orderly=way == "orderly")
        if not ctrl_c.place:
            break
        # Before anything was written, the device goes on as the program found it.
        if rig.device.log and not left_still(rig):
            moving.append((line, ctrl_c.place, names(rig)[-4:]))
    assert line + stride > 300
    assert not moving, moving
