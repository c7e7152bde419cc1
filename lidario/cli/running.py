"""Runs one coroutine by `lidario.run`: a signal ends it by cancelling it, and it leaves laser and motor off.

The verbs have their own exit codes, so here a signal becomes an exception of the command.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

import lidario
from lidario.cli.errors import Stopped
from lidario.cli.log import log_beside
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
