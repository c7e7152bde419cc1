"""Telling of trouble in the log, at most once a second: a sick device must not fill a disk."""

from __future__ import annotations

import logging
import time

__all__ = ["Trouble"]

INTERVAL_S = 1.0


class Trouble:
    """Warnings of one session.

    Args:
        log: Where they go.
    """

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._last: dict[str, float] = {}
        self._withheld: dict[str, int] = {}

    def tell(self, message: str, *values: object) -> None:
        """Log a warning, unless the same message was logged within the last second; those are counted."""
        now = time.monotonic()
        last = self._last.get(message)
        if last is not None and now - last < INTERVAL_S:
            self._withheld[message] = self._withheld.get(message, 0) + 1
            return
        self._last[message] = now
        withheld = self._withheld.pop(message, 0)
        if withheld:
            self._log.warning(message + " (and %d times more since the last such line)", *values, withheld)
        else:
            self._log.warning(message, *values)
