"""The command on a terminal of its own, and what it writes there."""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from select import select

from tests.support.children import BOUND, ROOT, gone_behind


@contextlib.contextmanager
def on_terminal(
    *arguments: str, stdout: int | None = None, kind: str = "xterm-256color", size: tuple[int, int] = (24, 80)
) -> Iterator[tuple[subprocess.Popen[bytes], Screen, int]]:
    """The command on a terminal of its own, which it is controlled by; stdout may be something else."""
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    environment |= {"TERM": kind, "PYTHONIOENCODING": "utf-8"}
    ours, theirs = os.openpty()
    resize(theirs, *size)
    with os.fdopen(ours, "rb", buffering=0):
        process = subprocess.Popen(
            [sys.executable, "-W", "error", "-m", "lidario", *arguments],
            cwd=ROOT, stdin=theirs, stdout=theirs if stdout is None else stdout, stderr=theirs, env=environment,
            start_new_session=True, preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )  # fmt: skip
        os.close(theirs)
        with gone_behind(process):
            yield process, Screen(ours), ours


def resize(handle: int, rows: int, columns: int) -> None:
    fcntl.ioctl(handle, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))


class Screen:
    """What a process writes to a terminal, piece by piece."""

    def __init__(self, handle: int) -> None:
        self._handle = handle
        self._unread = ""

    def until(self, end: str, right: Callable[[str], object] = lambda _: True) -> str:
        """The first piece that ends with `end` and is `right`."""
        deadline = time.monotonic() + BOUND
        while time.monotonic() < deadline:
            while end in self._unread:
                piece, _, self._unread = self._unread.partition(end)
                if right(piece):
                    return piece + end
            if select([self._handle], [], [], 1.0)[0]:
                self._unread += os.read(self._handle, 65536).decode("utf-8", "replace")
        raise AssertionError("it never came")
