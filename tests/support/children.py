"""Programs that use the library, as processes of their own, to be ended by signals; and their guards.

No test waits for `BOUND` unless something is broken: it only turns a hang into a failure.
"""

import os
import re
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import IO, Any, AnyStr, cast

from lidario.port.guard import NAME
from lidario.sim.device import Received
from lidario.sim.serve import PtyServer
from lidario.sim.server import Server

BOUND = 60.0
UNDISTURBED = "import logging\nlogging.getLogger('lidario').setLevel(logging.ERROR)\n"
"""Begin of a program whose stderr must stay empty: a terminal that a busy machine does not read in time loses
bytes, and what that costs is logged as a warning."""
FORKS = """
import atexit, os, sys, warnings
warnings.simplefilter('ignore')

def leave(code):
    if sys.version_info < (3, 14):
        sys.exit(code)
    atexit._run_exitfuncs()
    os._exit(code)
"""
"""Begin of a program that forks: beside threads later Pythons warn of it. A child leaves in order, with all that is
called at exit; from Python 3.14 on nothing that it raises ends a loop that ran in its parent."""
ROOT = Path(__file__).parents[2]
_POLL_S = 0.002


def finished(
    *words: str, environment: Mapping[str, str] | None = None, **streams: Any
) -> subprocess.CompletedProcess[str]:
    """Run Python with these words as a process, to its end; with other variables and other `streams` than pipes."""
    return subprocess.run(
        [sys.executable, *words],
        cwd=ROOT, env=_environment(environment), encoding="utf-8", timeout=2 * BOUND, check=False,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams},
    )  # fmt: skip


def started(
    *words: str, environment: Mapping[str, str] | None = None, **streams: Any
) -> AbstractContextManager[subprocess.Popen[str]]:
    """Start it; at the end of the block it is gone."""
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams}
    return gone_behind(
        subprocess.Popen(
            [sys.executable, *words], cwd=ROOT, env=_environment(environment), encoding="utf-8", **streams
        )
    )


def ended(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run this text as a program, to its end."""
    return finished("-c", program, *arguments)


def child(program: str, *arguments: str) -> AbstractContextManager[subprocess.Popen[str]]:
    """Start it; it may be told something."""
    return started("-c", program, *arguments, stdin=subprocess.PIPE)


@contextmanager
def gone_behind(process: subprocess.Popen[AnyStr]) -> Iterator[subprocess.Popen[AnyStr]]:
    """Behind the block the process is gone."""
    with process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def guard_like(program: int, line: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process that looks like the guard that this program has at that line, until it is killed."""
    command = [sys.executable, "-I", "-S", "-c", "print(flush=True); input()", NAME, str(program), line]
    with gone_behind(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)) as guard:
        assert guard.stdout is not None
        guard.stdout.readline()
        yield guard


def _environment(more: Mapping[str, str] | None) -> dict[str, str]:
    always = {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8", "PYTHONWARNINGS": "error"}
    return {**os.environ, **always, **(more or {})}


def line_of(stream: IO[str] | None) -> str:
    """The next line of a process's output.

    Nothing behind it is taken: neither `select` nor `communicate` sees what a stream of Python has read ahead.
    """
    assert stream is not None
    assert select.select([stream], [], [], BOUND)[0], "the process says nothing"
    line = bytearray()
    while not line.endswith(b"\n") and (byte := os.read(stream.fileno(), 1)):
        line += byte
    return line.decode("utf-8")


def until(condition: Callable[[], object], why: Callable[[], object] = lambda: "it never came to be") -> None:
    """Wait until `condition` holds."""
    deadline = time.monotonic() + BOUND
    while not condition():
        assert time.monotonic() < deadline, why()
        time.sleep(_POLL_S)


def requests(server: PtyServer) -> list[Received]:
    """Every request that the device has received."""
    with server.lock:
        return list(server.device.log)


def forget(server: PtyServer) -> None:
    """Forget the requests that the device has received; it keeps the last 4096, which some tests would exceed."""
    with server.lock:
        server.device.log.clear()


def is_still(server: Server) -> bool:
    """Whether laser and motor are off; a pseudo-terminal has no DTR, by which an A1 stops its motor."""
    with server.lock:
        device = cast("Any", server.device)
        by_dtr = getattr(device.profile, "motor", "") == "dtr"
        return not device.scanning and (by_dtr or not device.motor_on)


def was_stopped(server: PtyServer) -> bool:
    """Whether laser and motor are off because the device was told so after it was told to scan."""
    obeyed = [each.name for each in requests(server) if each.obeyed]
    began = max(at for at, name in enumerate(obeyed) if "scan" in name)
    return "stop" in obeyed[began:] and is_still(server)


def guards_of(program: int) -> list[int]:
    """The processes that guard a line of this program, also when it is dead. A zombie is none."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            arguments = (process / "cmdline").read_bytes().split(b"\0")
            if arguments[-4:-2] == [NAME.encode(), str(program).encode()]:
                found.append(int(process.name))
    return sorted(found)


def own_guards() -> list[int]:
    """The guards of this program."""
    return guards_of(os.getpid())


def children_that_ended() -> list[int]:
    """The children of this program for which it has not waited."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            # Behind the name, which may hold anything: the state, and whose child it is.
            state, parent = (process / "stat").read_text().rpartition(")")[2].split()[:2]
            if state == "Z" and int(parent) == os.getpid():
                found.append(int(process.name))
    return found


def told_by_proc(process: int, file: str, what: str) -> int:
    """A number that the system tells of a process."""
    path = Path(f"/proc/{process}/{file}")
    match = re.search(rf"^{what}:\s*(\d+)", path.read_text(), re.MULTILINE)
    assert match is not None, path
    return int(match[1])
