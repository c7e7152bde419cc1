"""One error, raised in several tasks."""

from __future__ import annotations

import copy
from typing import TypeVar

from lidario.errors import LidarError

__all__ = ["again", "twin_of"]

ErrorT = TypeVar("ErrorT", bound=LidarError)


def twin_of(error: ErrorT) -> ErrorT:
    """A copy of `error`, caused by it: each task that raises it gets a traceback of its own."""
    twin = copy.copy(error)
    twin.__cause__ = error
    return twin


def again(error: ErrorT) -> ErrorT:
    """A copy of `error` with the same cause, to be raised in its place by who keeps `error`.

    An exception that was raised holds the frames that it passed, and they hold the reader: a reader that is
    reachable from its own finalizer is never collected, and a session that nobody holds any more is never ended.
    """
    twin = copy.copy(error)
    twin.__cause__ = error.__cause__
    return twin
