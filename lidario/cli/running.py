"""Runs one coroutine by `lidario.run`: a signal ends it by cancelling it, and it leaves laser and motor off.

The verbs have their own exit codes, so here a signal becomes an exception of the command.

Meanwhile a thread writes what is logged to stderr. `logging` writes where it is called, and that is mostly the
event loop. A terminal that takes no output (Ctrl-S, a dead line) would hold up the loop, and with it the port and
the handling of signals. Where the program has chosen a handler of its own, nothing changes.
"""

from __future__ import annotations

import logging
import signal
import sys
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, TypeVar

import lidario
from lidario.cli.errors import Stopped
from lidario.cli.output import PROGRESS_GRACE_S, Worker
from lidario.cli.streams import message

T = TypeVar("T")
_BY_SIGNAL = 128
"""`lidario.run` adds the number of the signal to it."""


def run_until_stopped(work: Callable[[], Coroutine[Any, Any, object]]) -> bool:
    """As `run`, of what a signal may end at any time: whether it came to its own end."""
    try:
        run(work)
    except Stopped:
        if sys.stderr.isatty():
            message("")  # the terminal has just echoed ^C
        return False
    return True


def run(work: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Await ``work()`` in a new event loop.

    Raises:
        Stopped: SIGINT, SIGTERM or SIGHUP ended it.
    """
    try:
        with log_beside():
            return lidario.run(work())
    except KeyboardInterrupt:
        raise Stopped(signal.SIGINT) from None
    except SystemExit as ended:
        if isinstance(ended.code, int) and ended.code > _BY_SIGNAL:
            raise Stopped(ended.code - _BY_SIGNAL) from None
        raise


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
