"""The wall clock beside the clock of the event loop, also where it is set meanwhile.

A Raspberry Pi learns the time when the network is there, which may be long after a robot's program began. Slow
corrections change the monotonic clock, too, and so are no setting. Where they do not, they are followed in steps.
"""

from __future__ import annotations

import time
from typing import Final

LEAST_NS: Final = 10_000_000
"""Smaller differences are no setting: NTP corrects below a tenth of a second slowly."""
_SURE_NS: Final = 1_000_000
"""Reading both clocks takes a microsecond, and longer where the thread has to wait in the midst of it."""


class WallClock:
    """Watches the wall clock from now on; `loop_ns` is what the event loop's clock shows now."""

    def __init__(self, loop_ns: int) -> None:
        wall_ns = time.time_ns()
        self._offset_ns = wall_ns - loop_ns
        # The loop's clock may be a driven one. Whether the wall clock was set, only the system's own one tells.
        self._ahead_ns = wall_ns - time.monotonic_ns()

    def offset_ns(self) -> int:
        """Nanoseconds from the event loop's clock to the wall clock: the same number until the latter is set."""
        before = time.monotonic_ns()
        step = time.time_ns() - before - self._ahead_ns
        if abs(step) >= LEAST_NS and time.monotonic_ns() - before <= _SURE_NS:
            self._ahead_ns += step
            self._offset_ns += step
        return self._offset_ns
