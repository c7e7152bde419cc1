"""Programs that use the library, as processes of their own, to be ended by signals.

No test waits for `BOUND` unless something is broken: it only turns a hang into a failure.
"""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

from lidario.sim.device import Received
from lidario.sim.serve import PtyServer
from lidario.sim.server import Server

BOUND = 30.0
UNDISTURBED = "import logging\nlogging.getLogger('lidario').setLevel(logging.ERROR)\n"
"""Begin of a program whose stderr must stay empty: a terminal that a busy machine does not read in time loses
bytes, and what that costs is logged as a warning."""
_ROOT = Path(__file__).parents[2]
_POLL_S = 0.002


def ended(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a Python program as a process, to its end."""
    return subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=_ROOT, env=_environment(), capture_output=True, text=True, timeout=2 * BOUND, check=False,
    )  # fmt: skip


@contextlib.contextmanager
def child(program: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Start a Python program as a process; at the end of the block it is gone."""
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        cwd=_ROOT,
        env=_environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(_ROOT), "PYTHONWARNINGS": "error"}


def line_of(process: subprocess.Popen[str]) -> str:
    """The next line that a process prints."""
    assert process.stdout is not None
    assert select.select([process.stdout], [], [], BOUND)[0], "the process prints nothing"
    return process.stdout.readline()


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
