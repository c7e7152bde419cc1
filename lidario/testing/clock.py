"""The clock of an event loop, made fast: a wait of a second takes ten milliseconds.

A session and a simulated device in memory take their time from the event loop. So both become fast together when
the loop waits shorter than it was told, and then sets its clock as if it had waited in full. What the program
computes takes no time on this clock. Therefore every run of a test sees the same times.

A shortened wait is still a wait: another thread that works for the loop has the hundredth part of each timeout. A
wait without a timeout is not shortened.

It needs the selector and the clock of a loop of asyncio's own. Another loop (uvloop) keeps its pace.
"""

import asyncio
import time
from typing import Any

FAST = 100.0
"""How many times as fast. Opening, one scan and closing take 0.5 s on the clock; of that 5 ms remain."""
_LEAST_S = 0.001
"""The system waits a millisecond at least. Shorter waits are added up until they are worth one."""


class Clock:
    """The clock of one event loop of asyncio's own; made by `clock_of`. Waiting goes `pace` times as fast."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.pace: float = 1.0
        # Private since ever: in all loops of asyncio, on every system, this is what waits.
        selector: Any = loop._selector  # type: ignore[attr-defined]  # noqa: SLF001
        self._usual_select = selector.select
        self._usual_time = loop.time
        self._ahead = 0.0
        self._frozen: float | None = None
        self._owed = 0.0
        selector.select = self._select
        loop.time = self.time  # type: ignore[method-assign]

    def time(self) -> float:
        """The time of the loop; it stands still between two waits while it is fast."""
        if self._frozen is not None:
            return self._frozen
        return self._usual_time() + self._ahead

    def set(self, pace: float) -> None:
        """Change the pace; the time goes on from where it is."""
        now = self.time()
        self.pace = pace
        self._ahead = now - self._usual_time()
        self._frozen = now if pace != 1.0 else None

    def skip(self, seconds: float) -> None:
        """As if the program had slept for so long, without a turn of the loop."""
        if self._frozen is None:
            self._ahead += seconds
        else:
            self._frozen += seconds

    def _select(self, timeout: float | None = None) -> Any:
        if self._frozen is None or timeout is None or timeout <= 0.0:
            return self._usual_select(timeout)
        owed = self._owed + timeout / self.pace
        if owed < _LEAST_S:
            events = self._usual_select(0)
            if not events:
                self._owed = owed
                self._frozen += timeout
            return events
        began = time.monotonic()
        events = self._usual_select(owed)
        self._owed = 0.0
        # What has come ends the wait early, on this clock too.
        waited = min(1.0, (time.monotonic() - began) / owed) if events else 1.0
        if self._frozen is not None:
            self._frozen += timeout * waited
        return events


def clock_of(loop: asyncio.AbstractEventLoop) -> Clock | None:
    """The clock of a loop, always the same one; None where it cannot be made fast, or is closed."""
    found = getattr(loop.time, "__self__", None)
    if isinstance(found, Clock):
        return found
    return None if getattr(loop, "_selector", None) is None else Clock(loop)
