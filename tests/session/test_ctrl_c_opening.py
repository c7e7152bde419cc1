"""Ctrl-C is raised wherever the interpreter is while a device is opened that still streams: it is left still.

A program that is ended by Ctrl-C runs no `await` any more where the exception passes its event loop. So whatever
was written by then, a finalizer must know the device, and when it listens again.
"""

from __future__ import annotations

import asyncio
import gc
import sys
from types import FrameType
from typing import Any

import pytest

from tests.support.devices import Rig, both_families, left_still, make_rig, names
from tests.support.interrupt import no_collection
from tests.support.loop import DrivenLoop

pytestmark = [
    pytest.mark.discards("where Ctrl-C comes right after a request was written, what follows may come too early"),
    pytest.mark.usefixtures("quick_collection"),
]
LIBRARIES = ("/lidario/session/", "/lidario/port/")


@both_families
@pytest.mark.exhaustive("ending", sample=[("orderly", 37), ("at once", 37)], full=[("orderly", 5), ("at once", 3)])
def test_ctrl_c_at_every_line_of_opening(
    family: str, ending: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A loop that `asyncio.run` ends has more time to stop the device: every third line shows enough there."""
    orderly, stride = ending[0] == "orderly", ending[1]
    line, moving = stride // 2, []
    while True:
        rig = make_rig(family)
        place = ctrl_c_in_opening(rig, line, orderly, monkeypatch)
        if not place:
            break
        # Before anything was written, the device goes on as the program found it.
        if rig.device.log and not left_still(rig):
            moving.append((line, place, names(rig)[-4:]))
        line += stride
    assert line > 300
    assert not moving, moving


def ctrl_c_in_opening(rig: Rig, line: int, orderly: bool, monkeypatch: pytest.MonkeyPatch) -> str:
    """Raise KeyboardInterrupt at the n-th line that opening executes; where that was, or "" when it has fewer."""
    loop = DrivenLoop()
    monkeypatch.setattr("lidario.port.port.time.sleep", loop.block)
    now = round(loop.time() * 1e9)
    rig.device.begin_streaming(*([1, now] if rig.family == "rplidar" else [now]))
    left, place = line, ""

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal left, place
        if not any(each in frame.f_code.co_filename for each in LIBRARIES):
            return None
        if event == "line":
            left -= 1
            if left < 0:
                sys.settrace(None)
                place = f"{frame.f_code.co_qualname}:{frame.f_lineno}"
                raise KeyboardInterrupt
        return trace

    async def main() -> None:
        sys.settrace(trace)
        try:
            with no_collection():
                lidar = await rig.open()
        finally:
            sys.settrace(before)
        await lidar.close()

    before = sys.gettrace()
    try:
        if orderly:
            with asyncio.Runner(loop_factory=lambda: loop) as runner:
                runner.run(main())
        else:
            try:
                loop.run_until_complete(main())
            finally:
                loop.close()
    except KeyboardInterrupt:
        return place
    finally:
        sys.settrace(before)
        gc.collect()
    return ""
