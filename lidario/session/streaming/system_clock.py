"""Whether the wall clock was set, as on a Raspberry Pi, which learns the time when the network is there.

Slow corrections change the monotonic clock, too, and so are none. On a system where they do not, they are followed
in steps of `LEAST_NS`.
"""

from __future__ import annotations

import time
from typing import Final

LEAST_NS: Final = 10_000_000
"""Smaller differences are no setting: NTP corrects below a tenth of a second slowly."""
_SURE_NS: Final = 1_000_000
"""Reading both clocks takes a microsecond, and longer where the thread has to wait in the midst of it."""


class SystemClock:
    """Watches the wall clock from now on."""

    def __init__(self) -> None:
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def set_by(self) -> int:
        """By how many nanoseconds it was set since this was asked the last time; 0 where it was not."""
        before = time.monotonic_ns()
        wall = time.time_ns()
        after = time.monotonic_ns()
        step = wall - before - self._ahead_ns
        if abs(step) < LEAST_NS or after - before > _SURE_NS:
            return 0
        self._ahead_ns += step
        return step
