"""The system allows no more threads, or no event loop: each call says so at once, and nobody waits for them."""

import _thread
import asyncio
import errno
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import pytest

from lidario import CannotRecord, ConnectFailed, LidarError, open_lidar, open_sync
from lidario.loading import load
from lidario.port.background import run_in_thread
from lidario.session.finding.places import Places
from tests.cli.processes import in_memory, invoke
from tests.support.cable import next_after, on_a_cable
from tests.support.devices import left_still, make_rig, scanning
from tests.support.loop import driven, now

TOLD = "the system allows no more threads"


def refuse(*_: object) -> NoReturn:
    raise RuntimeError("can't start new thread")


@contextmanager
def no_threads(*, started_directly: bool = True) -> Iterator[None]:
    """No thread can be started; or none but by `_thread`, as where the one that it starts takes the last place."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(threading.Thread, "start", refuse)
        if started_directly:
            patch.setattr(_thread, "start_new_thread", refuse)
        yield


@pytest.mark.parametrize("started_directly", [True, False])
async def test_what_blocks_is_not_called(started_directly: bool) -> None:
    with no_threads(started_directly=started_directly), pytest.raises(ConnectFailed, match=TOLD):
        await run_in_thread(lambda: None)


@pytest.mark.parametrize("started_directly", [True, False])
def test_a_session_without_await_is_not_opened(started_directly: bool) -> None:
    with no_threads(started_directly=started_directly), pytest.raises(ConnectFailed, match=TOLD):
        open_sync(make_rig("rplidar").device)


def test_a_session_without_await_needs_an_event_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> NoReturn:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(asyncio.events, "new_event_loop", full)
    with pytest.raises(ConnectFailed, match=r"no event loop: this program may open no more files"):
        open_sync(make_rig("rplidar").device)


@driven
async def test_a_recording_does_not_begin_and_the_session_goes_on(tmp_path: Path) -> None:
    rig = make_rig("rplidar")
    async with open_lidar(rig.device) as lidar:
        with no_threads(), pytest.raises(CannotRecord, match=f"run.mcap cannot be written: {TOLD}"):
            await lidar.record(tmp_path / "run.mcap").start()
        assert await lidar.scan()
    assert left_still(rig)


@driven
async def test_a_lidar_that_is_away_comes_back_when_there_are_threads_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    candidates = Places.candidates

    async def looked_for(places: Places) -> object:
        """As for a serial port: the ports are listed in a thread."""
        await run_in_thread(lambda: None)
        return await candidates(places)

    monkeypatch.setattr(Places, "candidates", looked_for)
    async with on_a_cable("rplidar") as (cable, lidar), scanning(lidar) as stream:
        with no_threads():
            cable.pull()
            await asyncio.sleep(3.0)
        assert [each.message for each in caplog.records if TOLD in each.message]
        cable.plug()
        await next_after(stream, now())


def test_the_command_says_it_in_one_line() -> None:
    with no_threads():
        ended = invoke("scan", in_memory("rplidar-s2"))
    assert (ended.exit_code, ended.stdout) == (3, "")
    assert ended.stderr.startswith(f"error: {TOLD}")


@pytest.mark.parametrize("started_directly", [True, False])
def test_a_module_is_loaded_all_the_same(started_directly: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "numpy")
    with no_threads(started_directly=started_directly):
        assert load("lidario.errors").LidarError is LidarError
