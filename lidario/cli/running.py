"""Runs one coroutine by `lidario.run`: a signal ends it by cancelling it, and it leaves laser and motor off.

The verbs have their own exit codes, so here a signal becomes an exception of the command.

What is logged is told as a message. Where the program has chosen a handler of its own, that one has the log.
While the event loop runs, a thread writes messages, for the reason that `lidario.cli.output` tells. Behind a signal
nothing waits for long until it is taken.
"""

import logging
import signal
import sys
from collections.abc import Callable, Coroutine, Iterator
from contextlib import closing, contextmanager, nullcontext
from typing import Any, TypeVar

import lidario
from lidario.cli.errors import Stopped
from lidario.cli.output import Worker, progress
from lidario.cli.streams import hurry, message, messages_by

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


def run(work: Callable[[], Coroutine[Any, Any, T]], doing: str | Callable[[], str] | None = None) -> T:
    """Await ``work()`` in a new event loop; what it is `doing` is shown meanwhile, as by `progress`.

    Raises:
        Stopped: SIGINT, SIGTERM or SIGHUP ended it.
    """
    hurry(False)
    with nullcontext() if doing is None else progress(doing):
        try:
            with closing(Worker("lidario: messages")) as worker, messages_by(worker.put):
                return lidario.run(work())
        except KeyboardInterrupt:
            hurry(True)
            raise Stopped(signal.SIGINT) from None
        except SystemExit as ended:
            if isinstance(ended.code, int) and ended.code > _BY_SIGNAL:
                hurry(True)
                raise Stopped(ended.code - _BY_SIGNAL) from None
            raise


class _Log(logging.Handler):
    """Tells each record as a message."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            message(self.format(record))
        except Exception:
            self.handleError(record)


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
def log_told() -> Iterator[None]:
    """Tell what is logged in the block as messages, where the log has no handler."""
    root, handler = logging.getLogger(), _Log(logging.WARNING)
    if not logging.getLogger("lidario").hasHandlers():
        root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
