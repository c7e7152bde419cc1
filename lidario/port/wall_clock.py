"""The wall clock beside the clock of the event loop, also where it is set meanwhile.

A Raspberry Pi learns the time when the network is there, which may be long after a robot's program began. Slow
corrections change the monotonic clock, too, and so are no setting. Where they do not, they are followed in steps.
"""

import time
from collections.abc import Callable
from typing import Final

LEAST_NS: Final = 10_000_000
"""Smaller differences are no setting: NTP corrects below a tenth of a second slowly."""
_SURE_NS: Final = 1_000_000
"""Reading two clocks takes a microsecond, and longer where the thread has to wait in the midst of it."""
_TRIES: Final = 10


class WallClock:
    """Watches the wall clock from now on, beside `now`: the clock of the event loop, in nanoseconds."""

    def __init__(self, now: Callable[[], int]) -> None:
        self._offset_ns = _ahead_of(now)
        # The loop's clock may be a driven one. Whether the wall clock was set, only the system's own one tells.
        self._ahead_ns = _ahead_of(time.monotonic_ns)

    @property
    def wall_offset_ns(self) -> int:
        """Nanoseconds from the event loop's clock to the wall clock: the same number until the latter is set."""
        if abs(time.time_ns() - time.monotonic_ns() - self._ahead_ns) >= LEAST_NS:
            step = _ahead_of(time.monotonic_ns) - self._ahead_ns
            if abs(step) >= LEAST_NS:
                self._ahead_ns += step
                self._offset_ns += step
        return self._offset_ns


def _ahead_of(now: Callable[[], int]) -> int:
    """The wall clock minus another one, as they were read in the shortest time."""
    found: list[tuple[int, int]] = []
    while len(found) < _TRIES and (not found or min(found)[0] > _SURE_NS):
        before, wall, after = now(), time.time_ns(), now()
        found.append((after - before, wall - before))
    return min(found)[1]
