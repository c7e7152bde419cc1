"""One trouble, told to several: raised in several tasks, and logged at most once a second.

A sick device must not fill a disk.
"""

import copy
import logging
import math
import time
from typing import TypeVar

from lidario.basics.system import cause_of
from lidario.errors import InternalError, LidarError

ErrorT = TypeVar("ErrorT", bound=LidarError)
_log = logging.getLogger("lidario")
INTERVAL_S = 1.0


def twin_of(error: ErrorT) -> ErrorT:
    """A copy of `error` with the same cause, to be raised in its place: by several tasks, or by who keeps `error`.

    Each task so has a traceback of its own. And an exception that was raised holds the frames that it passed, and
    they hold the reader: a reader that is reachable from its own finalizer is never collected, and a session that
    nobody holds any more is never ended.
    """
    twin = copy.copy(error)
    twin.__cause__ = error.__cause__
    return twin


def to_be_kept(error: LidarError) -> None:
    """Have `error` let go of what the program was doing when it came up; its causes stay.

    An exception refers to the frames that it has passed, these to the frames that had called them, and an exception
    that comes up while another one is handled to the frames of that one. All of them may hold the session, and what
    a finalizer reaches must not. Of a mistake of ours the traceback is worth more than that.
    """
    each: BaseException | None = error
    while each is not None and not isinstance(each, InternalError):
        each.__traceback__ = None
        if not isinstance(each.__context__, OSError | LidarError):
            each.__context__ = None
        each = each.__cause__ or each.__context__


def mistake_of_ours(what: str, error: Exception) -> InternalError:
    """Log that lidario itself has failed, and return the error that says so."""
    if isinstance(error, MemoryError):
        failure = InternalError(f"{what}: {cause_of(error)}")
    else:
        _log.error("%s", what, exc_info=error)
        failure = InternalError(f"{what} ({error!r}); please report this")
    failure.__cause__ = error
    return failure


class Trouble:
    """Warnings of one session."""

    def __init__(self) -> None:
        # When each message was logged last, and how often it was withheld since.
        self._told: dict[str, tuple[float, int]] = {}

    def tell(self, message: str, *values: object) -> None:
        """Log a warning, unless the same message was logged within the last second; those are counted."""
        now = time.monotonic()
        last, withheld = self._told.get(message, (-math.inf, 0))
        if now - last < INTERVAL_S:
            self._told[message] = last, withheld + 1
            return
        self._told[message] = now, 0
        if withheld:
            _log.warning(message + " (and %d times more since the last such line)", *values, withheld)
        else:
            _log.warning(message, *values)
