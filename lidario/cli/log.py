"""What is logged while a command runs, on stderr.

`logging` writes where it is called, and that is mostly the event loop. A terminal that takes no output (Ctrl-S, a
dead line) would hold up the loop, and with it the port and the handling of signals. Therefore a thread writes
the warnings and errors here. Where the program has chosen a handler of its own, nothing changes.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from lidario.cli.output import PROGRESS_GRACE_S
from lidario.cli.streams import say

__all__ = ["log_beside", "nothing_logged"]


class _Beside(logging.Handler):
    """Writes each record from a thread."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="lidario: log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._lines.put(self.format(record) + "\n")
        except Exception:
            self.handleError(record)

    def close(self) -> None:
        """Let the thread write what is left, for at most `PROGRESS_GRACE_S`."""
        super().close()
        self._lines.put(None)
        self._thread.join(PROGRESS_GRACE_S)

    def _run(self) -> None:
        while (line := self._lines.get()) is not None:
            # The next line may find a reader again, or space on the disk.
            say(line)


@contextmanager
def nothing_logged() -> Iterator[None]:
    """Nothing that lidario logs in the block is shown."""
    log = logging.getLogger("lidario")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        log.setLevel(level)


@contextmanager
def log_beside() -> Iterator[None]:
    """Have a thread write what is logged in the block; changes nothing where there is a handler already."""
    root = logging.getLogger()
    if logging.getLogger("lidario").hasHandlers():
        yield
        return
    handler = _Beside()
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
        handler.close()
