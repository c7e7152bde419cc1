"""The names of pseudo-terminals are shared by all test processes, and are given anew when they are free.

A session that looks for its lidar opens the place where that was last. Where the lidar has gone, another process of
the same test run may have got a pseudo-terminal of this name meanwhile. So tests whose lidars leave their ports run
while no other test process uses pseudo-terminals.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

__all__ = ["names_are_safe", "needs_all_names"]

_USES = re.compile(r"\bserved\b|PtyServer|openpty|tests\.support\.terminals")
_FREES = re.compile(r"\breconnect=")
_LOCK = Path(tempfile.gettempdir()) / "lidario-tests-terminals.lock"


@contextmanager
def names_are_safe(module: Path) -> Iterator[None]:
    """Hold the lock that a test of this module needs: its own, a shared one, or none."""
    uses, frees = _kind(module)
    if not uses or sys.platform == "win32":
        yield
        return
    import fcntl

    # Another user's file would have to be written to be locked on some systems; each user has one.
    with _LOCK.with_suffix(f".{os.getuid()}").open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX if frees else fcntl.LOCK_SH)
        yield


def needs_all_names(module: Path) -> bool:
    """Whether tests of this module wait until no other test process uses pseudo-terminals."""
    return _kind(module)[1]


@cache
def _kind(module: Path) -> tuple[bool, bool]:
    text = module.read_text(encoding="utf-8")
    uses = bool(_USES.search(text))
    return uses, uses and bool(_FREES.search(text))
