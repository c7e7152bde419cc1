"""What is logged while a command runs, on stderr.

`logging` writes where it is called, and that is mostly the event loop. A terminal that takes no output (Ctrl-S, a
dead line) would hold up the loop, and with it the port and the handling of signals. Therefore a thread writes
the warnings and errors here. Where the program has chosen a handler of its own, nothing changes.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from lidario.cli.output import PROGRESS_GRACE_S, Worker
from lidario.cli.streams import message


class _Beside(logging.Handler):
    """Writes each record from a thread."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._worker = Worker("lidario: log", PROGRESS_GRACE_S)

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._worker.put(partial(message, self.format(record)))
        except Exception:
            self.handleError(record)

    def close(self) -> None:
        """Let the thread write what is left, for at most `PROGRESS_GRACE_S`."""
        super().close()
        self._worker.close()


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
