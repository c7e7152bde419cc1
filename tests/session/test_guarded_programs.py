"""Programs with `guard=True` that fork, reconnect, are stopped, get signals, or die in the midst of a request."""

import asyncio
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lidario.port.diagnose import holders
from lidario.port.simulation import simulate
from lidario.sim.serve import PtyServer, TcpServer, UdpServer
from tests.cli.processes import served
from tests.session.test_guarded import scan_once
from tests.support.children import (
    BOUND,
    FORKS,
    UNDISTURBED,
    child,
    forget,
    guards_of,
    is_still,
    line_of,
    requests,
    told_by_proc,
    until,
)
from tests.support.terminals import WaitingPtyServer

pytestmark = [
    pytest.mark.long,
    pytest.mark.discards("a guard cannot know what the killed program has just written, so it writes again"),
]

MOST_KB = 12 * 1024
"""Memory of a guard."""
HEAD = """
import asyncio, ctypes, os, signal, sys, time
import lidario

async def scan(path):
    async with lidario.open_lidar(path, guard=True, reconnect=True) as lidar:
        async for scan in lidar.scans():
            print(path, lidar.stats.reconnects, flush=True)
"""
SCAN = """
async def main():
    async with asyncio.TaskGroup() as tasks:
        for path in sys.argv[1:]:
            tasks.create_task(scan(path))

"""
RUN = "asyncio.run(main())"
SYNC = """
with lidario.open_sync(sys.argv[1], guard=True) as lidar:
    for scan in lidar.scans():
        print(scan.seq, flush=True)
"""
UVLOOP = "import uvloop\nuvloop.run(main())"
IN_HALF = """
async def main():
    async with lidario.open_lidar(sys.argv[1], guard=True) as lidar, lidar.scans() as scans:
        await anext(scans)
        os.write(os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY), bytes.fromhex(sys.argv[2]))
        os._exit(9)
"""
FORKING = """
async def main():
    async with lidario.open_lidar(sys.argv[1], guard=True) as lidar, lidar.scans() as scans:
        await anext(scans)
        for lives in (False, True):
            child = os.fork()
            if not child and not lives:
                leave(0)  # in order, with all finalizers
            if not child:
                time.sleep(600)
            if not lives:
                os.waitpid(child, 0)
        print(child, flush=True)
        async for scan in scans:
            pass
"""
ALONE = """
import lidario.port.guard, lidario.port.port

async def main():
    if len(sys.argv) > 2:
        ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER: orphans are given to this process
    ended, codes, waitpid = [], [], os.waitpid
    signal.signal(signal.SIGCHLD, lambda *_: ended.append(1))

    def waited(*which):
        child, code = waitpid(*which)
        codes.extend([code] if child else [])
        return child, code

    os.waitpid = waited
    # On a busy machine it may need longer than a session waits for it.
    lidario.port.guard.RELEASE_S = lidario.port.port.CLOSE_TIMEOUT_S = 60.0
    async with lidario.open_lidar(sys.argv[1], guard=True) as lidar:
        await lidar.scan()
        print("open", flush=True)
    try:
        print("children:", os.waitpid(-1, os.WNOHANG))
    except ChildProcessError:
        print("no children", codes)
"""
WHEN_TOLD = """
async def main():
    async with lidario.open_lidar(sys.argv[1], guard=True) as lidar:
        await lidar.get_modes()
        print("open", flush=True)
        while not os.path.exists(sys.argv[2]):
            await asyncio.sleep(0.01)
        await lidar.scan()
"""
IGNORING = """
for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
    signal.signal(number, signal.SIG_IGN)
"""


def kill(process: subprocess.Popen[str]) -> None:
    """Kill it; no guard is left."""
    process.kill()
    process.wait()
    until(lambda: not guards_of(process.pid))


def killed(process: subprocess.Popen[str], *servers: PtyServer | TcpServer | UdpServer) -> None:
    """Kill it; its devices are left still, and no guard is left."""
    kill(process)
    until(lambda: all(map(is_still, servers)), lambda: [server.device.log[-12:] for server in servers])


def scans(server: PtyServer) -> bool:
    with server.lock:
        return server.device.scanning


def guard_of(process: subprocess.Popen[str], count: int = 1) -> int:
    guards = guards_of(process.pid)
    assert len(guards) == count
    return guards[0]


@contextmanager
def guarded(
    program: str = HEAD + SCAN + RUN, model: str = "rplidar-s2"
) -> Iterator[tuple[PtyServer, subprocess.Popen[str], int]]:
    """A device, a program that has read a scan of it, and the guard of that."""
    with served(model) as server, child(UNDISTURBED + program, server.path) as process:
        line_of(process.stdout)
        yield server, process, guard_of(process)


PROGRAMS = {"asyncio": SCAN + RUN, "uvloop": SCAN + UVLOOP, "sync": SYNC}
MOTORS = ["rplidar-a2", "rplidar-a2-no-board", "rplidar-c1", "ldrobot-ld14p", "ydlidar-x4", "rplidar-old-firmware"]
KILLED = [*((program, "rplidar-s2") for program in PROGRAMS), ("asyncio", MOTORS[0])]


@pytest.mark.exhaustive("what", sample=KILLED, full=[*KILLED[:3], *(("asyncio", model) for model in MOTORS)])
def test_every_kind_of_program_and_of_motor(what: tuple[str, str]) -> None:
    """An accessory board is found when the stream is started, and only then it is known what stops the motor."""
    program, model = what
    with guarded(HEAD + PROGRAMS[program], model) as (server, process, _):
        if model != "rplidar-a2-no-board":
            killed(process, server)
            assert list(holders(server.path)) == []
        else:  # it always turns
            process.kill()
            until(lambda: not scans(server))


def test_a_device_that_has_not_said_what_it_is() -> None:
    """Only what stops every kind of motor, one after the other, can help then."""
    with served("rplidar-a2") as server:
        with server.lock:
            server.device.mute = True  # type: ignore[attr-defined]
        source = f"serial://{server.path}?baud={server.device.baudrate}&family=rplidar"
        with child(UNDISTURBED + HEAD + SCAN + RUN, source) as process:
            until(lambda: any(each.name == "get_info" for each in requests(server)))
            kill(process)
        until(lambda: [each.name for each in requests(server)][-2:] == ["stop", "set_motor_pwm"])


def test_a_motor_that_shall_go_on_goes_on() -> None:
    program = HEAD.replace("guard=True", "guard=True, keep_spinning=True") + SCAN + RUN
    with guarded(program) as (server, process, _):
        kill(process)
        until(lambda: not scans(server))
        assert not is_still(server)


def test_two_sessions_in_one_program_have_two_guards() -> None:
    with (
        served("rplidar-s2") as one,
        served("ydlidar-4ros") as other,
        child(UNDISTURBED + HEAD + SCAN + RUN, one.path, other.path) as process,
    ):
        until(lambda: not is_still(one) and not is_still(other))
        guard_of(process, 2)
        killed(process, one, other)


@pytest.mark.parametrize("kind", [TcpServer, UdpServer])
def test_over_a_network_and_the_next_program_waits(
    kind: type[TcpServer | UdpServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine may let the guard stand for longer than it is waited for.
    monkeypatch.setattr("lidario.port.guard.WAIT_S", BOUND)
    with kind(simulate("rplidar-s2", spin_up=0)) as server:
        scheme = "tcp" if kind is TcpServer else "udp"
        source = f"{scheme}://{server.address[0]}:{server.address[1]}"
        with child(UNDISTURBED + HEAD + SCAN + RUN, source) as process:
            line_of(process.stdout)
            guard = guard_of(process)
            # It is made to hold the connection for a while longer; a bridge takes one.
            os.kill(guard, signal.SIGSTOP)
            process.kill()
            process.wait()
            threading.Timer(0.2, os.kill, (guard, signal.SIGCONT)).start()
            assert asyncio.run(scan_once(source, "rplidar", guard=True)).mode
            assert guards_of(process.pid) == []
        until(lambda: is_still(server))


def test_a_line_that_reconnecting_has_made(tmp_path: Path) -> None:
    device = simulate("rplidar-s2", spin_up=0)
    device.boot_s = 0.2  # type: ignore[attr-defined]
    path = tmp_path / "port"
    with WaitingPtyServer(device) as server:
        server.link(path)
        with child("import logging\nlogging.disable()\n" + HEAD + SCAN + RUN, str(path)) as process:
            line_of(process.stdout)
            first = guard_of(process)
            server.replug(0.1)
            while "1" not in line_of(process.stdout).split()[1:]:
                pass
            assert guard_of(process) != first
            killed(process, server)


def test_signals_of_the_terminal_do_not_end_it() -> None:
    with guarded(HEAD + SCAN + IGNORING + RUN) as (server, process, guard):
        assert os.getsid(guard) != os.getsid(process.pid)
        for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGQUIT, signal.SIGTSTP):
            os.kill(guard, number)
        for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
            process.send_signal(number)
        forget(server)
        for _ in range(5):
            line_of(process.stdout)
        assert guard_of(process) == guard
        assert requests(server) == []
        killed(process, server)


def test_it_sleeps_in_little_memory_while_the_program_lives_also_while_that_is_frozen() -> None:
    with guarded() as (server, process, guard):
        for _ in range(2):
            line_of(process.stdout)
        forget(server)
        before = told_by_proc(guard, "status", "voluntary_ctxt_switches")
        for _ in range(10):
            line_of(process.stdout)
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        assert told_by_proc(guard, "status", "voluntary_ctxt_switches") == before
        shared, whole = (told_by_proc(guard, "smaps_rollup", what) for what in ("Pss", "Rss"))
        assert shared <= whole < MOST_KB
        assert requests(server) == []
        assert not is_still(server)
        killed(process, server)


@pytest.mark.parametrize("half", ["a58205", "a583", "a5"], ids=["EXPRESS_SCAN", "HQ_SCAN", "one byte"])
def test_half_a_request_that_was_written_last(half: str) -> None:
    with served("rplidar-s2") as server:
        with child(UNDISTURBED + HEAD + IN_HALF + RUN, server.path, half) as process:
            assert process.wait() == 9
            until(lambda: not guards_of(process.pid))
        until(lambda: is_still(server), lambda: requests(server)[-12:])


@pytest.mark.parametrize("model", ["rplidar-s2", "ydlidar-4ros"])
def test_a_response_that_the_device_still_owes(model: str, tmp_path: Path) -> None:
    """It hears nothing before it has responded, and begins to scan then."""
    begin = tmp_path / "begin"
    with served(model) as server:
        with child(UNDISTURBED + HEAD + WHEN_TOLD + RUN, server.path, str(begin)) as process:
            line_of(process.stdout)
            with server.lock:
                server.device.response_delay_s = 0.3  # type: ignore[attr-defined]
            begin.touch()
            until(lambda: any("scan" in each.name for each in requests(server)))
            killed(process, server)
        assert requests(server)[-1].obeyed


def test_a_forked_child_neither_keeps_it_from_its_work_nor_begins_it() -> None:
    with served("rplidar-s2") as server, child(FORKS + HEAD + FORKING + RUN, server.path) as parent:
        forked = int(line_of(parent.stdout))
        try:
            assert not is_still(server)
            killed(parent, server)
        finally:
            os.kill(forked, signal.SIGKILL)


@pytest.mark.parametrize("adopts", [[], ["yes"]], ids=["", "is given orphans"])
def test_the_program_has_no_child_that_it_did_not_start(adopts: list[str]) -> None:
    with served("rplidar-s2") as server:
        with child(UNDISTURBED + HEAD + ALONE + RUN, server.path, *adopts) as process:
            assert line_of(process.stdout) == "open\n"
            guard_of(process)
            out, said = process.communicate()
            # Whatever watches processes is told that they ended well.
            assert (out, said) == (f"no children {[0] * (1 + len(adopts))}\n", "")
            assert guards_of(process.pid) == []
        until(lambda: is_still(server))
