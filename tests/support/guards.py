"""The guards that there are, as the system lists them."""

import os
import re
from contextlib import suppress
from pathlib import Path

from lidario.port.guard import NAME


def guards_of(program: int) -> list[int]:
    """The processes that guard a line of this program, also when it is dead. A zombie is none."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            arguments = (process / "cmdline").read_bytes().split(b"\0")
            if arguments[-4:-2] == [NAME.encode(), str(program).encode()]:
                found.append(int(process.name))
    return sorted(found)


def kilobytes(pid: int, what: str) -> int:
    """What a process needs of memory: ``Rss``, or ``Pss``, which divides what several share."""
    return _number(Path(f"/proc/{pid}/smaps_rollup"), what)


def switches(pid: int) -> int:
    """How often a process has gone to sleep: as often as it was woken."""
    return _number(Path(f"/proc/{pid}/status"), "voluntary_ctxt_switches")


def _number(path: Path, what: str) -> int:
    match = re.search(rf"^{what}:\s*(\d+)", path.read_text(), re.MULTILINE)
    assert match is not None, path
    return int(match[1])


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
