"""Sessions without ``await``: the same methods, errors and endings as `Lidar`, and Ctrl-C at any moment."""

from __future__ import annotations

import asyncio
import gc
import inspect
import os
import pickle
import random
import signal
import threading
import time
from collections.abc import Generator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import lidario
from lidario.session.lidar import Lidar
from lidario.session.streaming.stream import ScanStream
from lidario.sim.serve import PtyServer
from lidario.sync.lidar import SyncLidar, open_sync
from lidario.sync.loop_thread import LoopThread
from lidario.sync.streams import SyncScanStream
from lidario.testing import SimulatedLidar
from tests.cli.processes import served
from tests.support.children import BOUND, child, is_still, line_of, until, was_stopped
from tests.support.devices import both_families, is_off, left_still, make_rig


def public(of: type) -> set[str]:
    return {name for name in dir(of) if not name.startswith("_")}


def test_nothing_of_lidar_is_missing() -> None:
    assert public(SyncLidar) == public(Lidar) | {"source", "info", "config"}
    assert public(SyncScanStream) == (public(ScanStream) | {"close"}) - {"aclose", "release"}
    for name in public(Lidar):
        ours, theirs = getattr(SyncLidar, name), getattr(Lidar, name)
        assert ours.__doc__
        if inspect.iscoroutinefunction(theirs) and name != "close":
            assert inspect.signature(ours) == inspect.signature(theirs)
            assert ours.__doc__ == theirs.__doc__
            assert not inspect.iscoroutinefunction(ours)
    asked, answered = inspect.signature(open_sync), inspect.signature(lidario.open_lidar)
    assert asked.parameters == answered.parameters


@pytest.mark.long
@both_families
def test_scans_questions_and_settings(family: str) -> None:
    rig = make_rig(family)
    with open_sync(rig.device) as lidar:
        assert lidar.info == lidar.get_info()
        assert lidar.health == lidar.get_health()
        assert lidar.source in repr(lidar)
        scans = []
        for scan in lidar.scans(depth=4):
            scans.append(scan)
            if len(scans) == 3:
                break
        # The clock is real: what a busy machine left out is told by a number.
        assert scans[0].seq < scans[1].seq < scans[2].seq
        assert lidar.is_scanning
        assert lidar.mode is not None
        assert lidar.mode.name == scans[0].mode
        assert lidar.measured_scan_frequency == pytest.approx(1 / rig.turn_s, rel=0.05)
        assert lidar.set_motor_speed(480, verify=False) == pytest.approx(480, rel=0.05)
        assert lidar.scan().seq > scans[2].seq
        lidar.stop()
        assert "idle" in repr(lidar)
        assert lidar.stats.scans >= 4
    assert left_still(rig)
    lidar.close()
    assert lidar.stats.scans >= 4
    with pytest.raises(lidario.SessionClosed, match=r"open_sync\(\) makes a new one"):
        lidar.get_health()
    with pytest.raises(lidario.SessionClosed):
        next(lidar.scans())


@pytest.mark.long
def test_a_reader_that_computes_gets_the_latest_scan() -> None:
    rig = make_rig("rplidar")
    with open_sync(rig.device) as lidar:
        with lidar.scans() as scans:
            first = next(scans)
            before = lidar.stats.scans
            until(lambda: lidar.stats.scans >= before + 4)
            latest = next(scans)
            assert latest.seq >= first.seq + 3
            assert scans.dropped == latest.dropped_before > 0
        assert not lidar.is_scanning


def test_errors_are_those_of_the_session() -> None:
    with pytest.raises(lidario.ConnectFailed, match="no such"):
        open_sync("/dev/there-is-none")
    with pytest.raises(lidario.ConnectFailed, match="name a model"):
        open_sync("sim://")
    with open_sync(SimulatedLidar("ydlidar-4ros", pace=100)) as lidar:
        with pytest.raises(lidario.Unsupported):
            lidar.get_sample_rate()
        with pytest.raises(lidario.InvalidValue):
            lidar.scans(depth=0)
        with pytest.raises(lidario.InvalidValue):
            lidar.set_scan_frequency(float("nan"))


def test_where_a_loop_runs_already() -> None:
    async def notebook() -> int:
        with open_sync(SimulatedLidar(pace=100)) as lidar:
            return len(lidar.scan())

    assert asyncio.run(notebook()) > 1000


@pytest.mark.long
def test_several_threads_share_it() -> None:
    rig = make_rig("rplidar")
    found: list[int] = []
    with open_sync(rig.device) as lidar:

        def read() -> None:
            with lidar.scans() as scans:
                found.append(next(scans).seq)
                lidar.get_health()
                found.append(next(scans).seq)

        threads = [threading.Thread(target=read) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert len(found) == 6
    assert left_still(rig)


def test_closing_ends_what_other_threads_wait_for() -> None:
    rig = make_rig("rplidar")
    ended: list[BaseException] = []
    lidar = open_sync(rig.device)
    first = threading.Event()

    def read() -> None:
        try:
            for _ in lidar.scans():
                first.set()
        except lidario.LidarError as error:
            ended.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    assert first.wait(BOUND)
    lidar.close()
    thread.join(BOUND)
    assert not thread.is_alive()
    assert [type(error) for error in ended] == [lidario.SessionClosed]
    assert left_still(rig)


def test_stopping_ends_a_loop() -> None:
    with open_sync(SimulatedLidar(pace=100)) as lidar:
        seen = 0
        for _ in lidar.scans():
            seen += 1
            lidar.stop()
        assert seen in (1, 2)  # one more may have come before the stop


def test_a_tap_cannot_wait_for_its_own_thread() -> None:
    refused: list[str] = []
    with open_sync(SimulatedLidar(pace=100)) as lidar:

        def asking(direction: str, data: bytes, now: int) -> None:
            try:
                lidar.get_health()
            except lidario.LocalProtocolError as error:
                refused.append(str(error))

        lidar.tap(asking)
        lidar.get_info()
        lidar.untap(asking)
    assert "cannot wait for itself" in refused[0]


def test_one_that_nobody_holds_is_closed() -> None:
    rig = make_rig("rplidar")
    lidar = open_sync(rig.device)
    next(lidar.scans())
    del lidar
    gc.collect()
    until(lambda: left_still(rig))


@pytest.mark.long
def test_it_is_not_sent_to_another_process() -> None:
    with open_sync(make_rig("rplidar").device) as lidar:
        for held in (lidar, lidar.scan, lidar.scans(), lidar.line_changes(), lidar.record("never.mcap")):
            with pytest.raises(lidario.LocalProtocolError, match="another process: send its scans"):
                pickle.dumps(held)


def test_a_forked_child_is_refused_and_its_exit_stops_nothing(tmp_path: Path) -> None:
    """It may leave all blocks."""
    rig = make_rig("rplidar")
    with open_sync(rig.device) as lidar, lidar.record(tmp_path / "run.mcap"):
        scans, recording = lidar.scans(), lidar.record(tmp_path / "other.mcap")
        next(scans)
        child_pid = os.fork()
        if not child_pid:
            code = 1
            try:
                lidar.get_health()
            except lidario.LocalProtocolError:
                with suppress(lidario.LocalProtocolError):
                    scans.close()
                    recording.__exit__()
                    lidar.close()
                    code = 7
            os._exit(code)
        assert os.waitstatus_to_exitcode(os.waitpid(child_pid, 0)[1]) == 7
        assert next(scans).seq > 0
        assert rig.device.scanning


@pytest.mark.long
@pytest.mark.exhaustive("rounds", sample=[4], full=[8])
@both_families
def test_ctrl_c_at_any_moment(family: str, rounds: int, request: pytest.FixtureRequest) -> None:
    """Opening, reading, asking, closing: the wait ends, and the device is still when the session is closed."""
    rounds = request.config.getoption("--rounds") or rounds
    chance = random.Random(family)
    # A timer of the system: starting a thread is no moment for Ctrl-C.
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    ended_by_it = 0
    try:
        for _ in range(rounds):
            rig = make_rig(family)
            threads = set(threading.enumerate())
            try:
                signal.setitimer(signal.ITIMER_REAL, chance.uniform(0.001, 0.9))
                with open_sync(rig.device) as lidar:
                    while True:
                        lidar.scan()
                        for scan in lidar.scans():
                            if scan.seq % 3 == 2:
                                break
                        lidar.get_health()
            except KeyboardInterrupt:
                ended_by_it += 1
            wait_for_threads(threads)
            log = [each.name for each in rig.device.log]
            assert is_off(rig.device), log
    finally:
        signal.signal(signal.SIGALRM, before)
    assert ended_by_it == rounds


def wait_for_threads(before: set[threading.Thread]) -> None:
    until(lambda: before.issuperset(threading.enumerate()), threading.enumerate)


def test_one_that_was_not_started_ends_when_its_thread_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where Ctrl-C came first."""
    made = list[threading.Thread]()

    class Slow(threading.Thread):
        def run(self) -> None:
            made.append(self)
            super().run()
            time.sleep(0.05)

    monkeypatch.setattr(threading, "Thread", Slow)
    LoopThread().end()
    assert [thread.is_alive() for thread in made] == [False]


def test_a_session_that_opens_just_as_it_is_cancelled_is_closed() -> None:
    begun, closed = threading.Event(), threading.Event()

    class Opening:
        async def open(self) -> Opening:
            with suppress(asyncio.CancelledError):
                begun.set()
                await asyncio.sleep(1000)
            return self

        def __await__(self) -> Generator[Any, None, Opening]:
            return self.open().__await__()

        async def close(self) -> None:
            closed.set()

    loop = LoopThread()
    opening = threading.Thread(target=loop.open, args=(Opening(),))
    opening.start()
    assert begun.wait(BOUND)
    loop.end()
    opening.join()
    assert closed.is_set()


PROGRAM = """
import sys
import lidario

lidar = lidario.open_sync(sys.argv[1])
for scan in lidar.scans():
    print(scan.seq, flush=True)
    {then}
"""


ENDINGS = [("if scan.seq > 1: sys.exit(5)", 5), ("if scan.seq > 1: raise OSError('mine')", 1), ("", None)]
"""What the program does, and its exit code; None where it has to be ended by a signal."""


@pytest.mark.long
@pytest.mark.exhaustive("ending", sample=ENDINGS[1:2], full=ENDINGS)
def test_a_program_that_ends_without_closing(ending: tuple[str, int | None]) -> None:
    then, code = ending
    with served("rplidar-s2") as server:
        assert isinstance(server, PtyServer)
        with child(PROGRAM.format(then=then), server.path) as process:
            for _ in range(2):
                assert line_of(process.stdout).strip().isdecimal()
            if code is None:
                process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=BOUND)
        assert process.returncode == (-signal.SIGINT if code is None else code), said
        assert was_stopped(server)
        assert is_still(server)
