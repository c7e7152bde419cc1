"""Guards of programs that are dead: each holds its line until it has stopped the device (`lidario.port.guard`).

Who opens the line meanwhile waits for it. Only where /proc tells.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

from lidario.port.guard import NAME

WAIT_S = 4.0
"""Longest time for which a line is not opened for that. Mostly it is 0.15 s; 2.7 s where the device owed a response
(`lidario.port.guard_process.LONGEST_S`)."""
POLL_S = 0.01


def wait_for_guard(line: str) -> None:
    """Block while the guard of a dead program holds this line, a serial port or one of a network.

    A bridge may take one connection only, and a device would hear both.
    """
    deadline = time.monotonic() + WAIT_S
    while time.monotonic() < deadline:
        # A serial port has several names.
        same = os.path.realpath(line)
        if not any(os.path.realpath(held) == same and _is_dead(program) for program, held in _guards()):
            return
        time.sleep(POLL_S)


def _guards() -> Iterator[tuple[int, str]]:
    """All guards: the number of the program of each, and its line as that has named it."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            # NAME, PID and PORT; a zero byte ends each.
            *_, name, program, line, _ = os.fsdecode((process / "cmdline").read_bytes()).split("\0")
            if name == NAME:
                yield int(program), line
        except (OSError, ValueError):
            continue  # it has just ended, or has fewer arguments


def _is_dead(pid: int) -> bool:
    """Whether a process has ended, be it a zombie or gone."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state in "ZX"
