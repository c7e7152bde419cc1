"""The system gives no more files, memory or threads: each call names that, and the cure, once, and at once."""

import _thread
import asyncio
import errno
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import pytest
import serial

import lidario
from lidario import CannotRecord, ConnectFailed, LidarError, open_lidar, open_sync
from lidario.cli.errors import report
from lidario.cli.output import Worker
from lidario.loading import load
from lidario.port.background import run_in_thread
from lidario.port.diagnose import why_not_opened
from lidario.recording import record
from lidario.session.finding.places import Places
from lidario.session.talking.trouble import mistake_of_ours
from tests.cli.processes import in_memory, invoke, run
from tests.support.cable import next_after, on_a_cable
from tests.support.children import ROOT
from tests.support.devices import left_still, make_rig, scanning
from tests.support.leaks import leaves_nothing
from tests.support.loop import driven, now

S2 = "sim://rplidar-s2?via=memory"
NO_FILES = r"this program may open no more files: `ulimit -n`, or LimitNOFILE of its service, says how many"
NO_MEMORY = "no memory is left"
LEFT = [
    (OSError(errno.EMFILE, os.strerror(errno.EMFILE), "/usr/lib/idna.py"), NO_FILES),
    (MemoryError("Unable to allocate 128. KiB"), NO_MEMORY),
]
what_is_left = pytest.mark.parametrize(("error", "told"), LEFT, ids=["files", "memory"])


def failing(error: Exception) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


def test_of_a_port() -> None:
    """pyserial names the number of the error twice."""
    error = serial.SerialException(errno.EMFILE, "could not open port /dev/ttyUSB0: [Errno 24] Too many open files")
    assert str(why_not_opened("/dev/ttyUSB0", error)) == f"could not open '/dev/ttyUSB0': {NO_FILES}"


@what_is_left
@driven
async def test_of_a_module_loaded_at_opening(error: Exception, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.session.opening.anyio.CancelScope", failing(error))
    with pytest.raises(ConnectFailed) as caught:
        await open_lidar(S2)
    assert str(caught.value) == f"{S2}: {told}"


@what_is_left
@driven
async def test_of_a_recording(error: Exception, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its thread loads ``mcap``."""
    path = tmp_path / "a.mcap"
    async with open_lidar(S2) as lidar:
        monkeypatch.setattr(record, "Parts", failing(error))
        with pytest.raises(CannotRecord) as caught:
            await lidar.record(path).start()
    assert str(caught.value) == f"{path} cannot be written: {told}"


@what_is_left
def test_of_the_command(error: Exception, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    report(error)
    assert capsys.readouterr().err == f"error: {told}\n"


def test_lack_of_memory_is_no_mistake_of_ours(caplog: pytest.LogCaptureFixture) -> None:
    failure = mistake_of_ours("lidario failed at what the device sent", MemoryError())
    assert isinstance(failure, lidario.InternalError)
    assert str(failure) == f"lidario failed at what the device sent: {NO_MEMORY}"
    assert not caplog.records


@pytest.mark.long
def test_a_package_that_cannot_be_loaded_is_told_in_a_line(tmp_path: Path) -> None:
    """As numpy, which tells a page of what may be wrong, and loads far more than anything before it."""
    (tmp_path / "numpy.py").write_text(
        "try:\n    raise ImportError('libstdc++.so.6: failed to map segment')\n"
        "except ImportError as error:\n    raise ImportError('a page of advice') from error\n"
    )
    places = os.pathsep.join((str(tmp_path), str(ROOT)))
    done = run("info", S2, environment={"PYTHONPATH": places})
    assert done.returncode == 1
    assert done.stderr.startswith("error: the command cannot be loaded: libstdc++.so.6: failed to map segment. Is")
    assert done.stderr.count("\n") == 1
    assert "Traceback" in run("info", S2, "--traceback", environment={"PYTHONPATH": places}).stderr


NO_THREADS = "the system allows no more threads"


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


directly_or_not = pytest.mark.parametrize("started_directly", [True, False])


@directly_or_not
async def test_what_blocks_is_not_called_and_a_session_without_await_is_not_opened(started_directly: bool) -> None:
    with no_threads(started_directly=started_directly):
        with pytest.raises(ConnectFailed, match=NO_THREADS):
            await run_in_thread(lambda: None)
        with pytest.raises(ConnectFailed, match=NO_THREADS):
            open_sync(make_rig("rplidar").device)


def test_a_session_without_await_needs_an_event_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asyncio.events, "new_event_loop", failing(LEFT[0][0]))
    with pytest.raises(ConnectFailed, match=r"no event loop: this program may open no more files"):
        open_sync(make_rig("rplidar").device)


@driven
async def test_a_recording_does_not_begin_and_the_session_goes_on(tmp_path: Path) -> None:
    rig = make_rig("rplidar")
    async with open_lidar(rig.device) as lidar:
        with no_threads(), pytest.raises(CannotRecord, match=f"run.mcap cannot be written: {NO_THREADS}"):
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
        assert [each.message for each in caplog.records if NO_THREADS in each.message]
        cable.plug()
        await next_after(stream, now())


async def test_no_memory_for_a_thread_is_no_endless_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread that was to start it ended by that, and told nobody."""
    numpy = sys.modules["numpy"]
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", failing(MemoryError()))
        with pytest.raises(ConnectFailed, match=NO_THREADS):
            await run_in_thread(lambda: None)
        with pytest.raises(ConnectFailed, match=NO_THREADS):
            open_sync(make_rig("rplidar").device)
        patch.delitem(sys.modules, "numpy")
        patch.setattr("lidario.loading.import_module", lambda name: name)
        assert str(load("numpy")) == "numpy"
    assert sys.modules["numpy"] is numpy


async def test_a_thread_that_dies_at_its_first_step_is_no_endless_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    """It found no memory for that, and `Thread.start` waits for it for ever."""
    released = threading.Event()
    numpy = sys.modules["numpy"]
    with monkeypatch.context() as patch:
        patch.setattr("lidario.port.latch._PIECES", 1)
        patch.setattr("lidario.port.latch._PIECE_S", 0.01)
        patch.setattr(threading.Thread, "start", lambda _: released.wait())
        with pytest.raises(ConnectFailed, match=NO_THREADS):
            await run_in_thread(lambda: None)
        with pytest.raises(ConnectFailed, match=NO_THREADS):
            open_sync(make_rig("rplidar").device)
        with pytest.raises(ConnectFailed, match=NO_THREADS):
            Worker("of the command")
        patch.delitem(sys.modules, "numpy")
        patch.setattr("lidario.loading.import_module", lambda name: name)
        assert str(load("numpy")) == "numpy"
        released.set()
    assert sys.modules["numpy"] is numpy


@pytest.mark.parametrize("via", ["pty", "tcp", "udp"])
async def test_a_simulated_lidar_that_needs_one_is_not_opened_and_leaves_no_descriptor(via: str) -> None:
    with leaves_nothing(), no_threads(started_directly=False), pytest.raises(ConnectFailed, match=NO_THREADS):
        await open_lidar(f"sim://rplidar-s2?via={via}")


@pytest.mark.parametrize("way", ["--pty", "--tcp=:0", "--udp=:0"])
def test_a_simulated_lidar_of_the_command_that_needs_one(way: str) -> None:
    with no_threads(started_directly=False):
        ended = invoke("sim", "rplidar-s2", way)
    assert NO_THREADS in ended.stderr
    assert "unexpected" not in ended.stderr
    assert ended.exit_code in (2, 3)


def test_the_command_says_it_in_one_line() -> None:
    with no_threads():
        ended = invoke("scan", in_memory("rplidar-s2"))
    assert (ended.exit_code, ended.stdout) == (3, "")
    assert ended.stderr.startswith(f"error: {NO_THREADS}")


@directly_or_not
def test_a_module_is_loaded_all_the_same(started_directly: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "numpy")
    with no_threads(started_directly=started_directly):
        assert load("lidario.errors").LidarError is LidarError
