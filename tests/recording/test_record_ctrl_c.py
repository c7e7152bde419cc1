"""Ctrl-C at every call that begins a recording, on a loop that does not handle it: nothing of it is left."""

import gc
import weakref
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from tests.support.devices import make_rig
from tests.support.interrupt import StartedThreads, as_if_running, at_every_call, interrupted_at_call
from tests.support.loop import DrivenLoop


@pytest.mark.long
@pytest.mark.exhaustive("stride", sample=[4], full=[1])
def test_ctrl_c_at_every_call_of_starting(stride: int, tmp_path: Path) -> None:
    with closing(DrivenLoop()) as loop:
        lidar = loop.run_until_complete(make_rig("rplidar").open().__aenter__())

        def tried(number: int, started: StartedThreads) -> str:
            recording = lidar.record(tmp_path / f"{number}.mcap")
            starting = recording.start()
            with as_if_running(loop):
                place = interrupted_at_call(number, partial(next, starting.__await__(), None))
            starting.close()
            if not place:
                loop.run_until_complete(recording.close())
            assert not recording.is_running, place
            started.all_ended(place)
            kept = weakref.ref(recording)
            del recording, starting
            gc.collect()
            assert kept() is None, place
            return place

        assert at_every_call(tried, stride) * stride > 36
        loop.run_until_complete(lidar.close())
