"""A second Ctrl-C is raised wherever the interpreter is, also in the midst of `close`: the device is left still."""

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
    pytest.mark.discards("where Ctrl-C comes right after the stop requests were written, they are written again"),
    pytest.mark.usefixtures("quick_collection"),
]
LIBRARY = "/lidario/session/"


@both_families
@pytest.mark.exhaustive("stride", sample=[5], full=[1])
def test_ctrl_c_at_every_line_of_close(family: str, stride: int, monkeypatch: pytest.MonkeyPatch) -> None:
    line, cut = 0, True
    while cut:
        rig = make_rig(family)
        cut = ctrl_c_in_close(rig, line, monkeypatch)
        assert left_still(rig), (line, names(rig)[-4:])
        line += stride
    assert line > 30


def ctrl_c_in_close(rig: Rig, line: int, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Raise KeyboardInterrupt at the n-th line that closing executes; False when it has fewer."""
    loop = DrivenLoop()
    monkeypatch.setattr("lidario.port.port.time.sleep", loop.block)
    left = line

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal left
        if LIBRARY not in frame.f_code.co_filename:
            return None
        if event == "line":
            left -= 1
            if left < 0:
                sys.settrace(None)
                raise KeyboardInterrupt
        return trace

    async def main() -> None:
        lidar = await rig.open()
        stream = lidar.scans()
        await anext(stream)
        sys.settrace(trace)
        try:
            await lidar.close()
        finally:
            sys.settrace(before)

    before = sys.gettrace()
    try:
        with no_collection(), asyncio.Runner(loop_factory=lambda: loop) as runner:
            runner.run(main())
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
        gc.collect()
    return False
