"""Work that may take long, done in steps: each turn of the event loop takes a bounded time of it.

A peer decides how many bytes come, and what they are. Some cost a thousand times what ordinary ones do: noise that
looks like packets, revolutions of two packets each. So what is done with them is a generator that yields after each
small piece, and `Turns` goes on with it in later turns of the loop. Between two of them every other task runs.

What comes meanwhile waits in order. How much that may be is for the caller to say: `Turns.size` tells it.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Final

TURN_NS: Final = 10_000_000
"""Nanoseconds of each turn of the loop. An ordinary revolution takes half a millisecond, so that what comes while a
program blocks its loop for two seconds is decoded in one turn, and a reader is given the latest."""
MOST_WAITING: Final = 1 << 20
"""Bytes that may wait: 15 s of the fastest stream, which take 0.1 s."""

DELIVERY_BYTES: Final = 512
"""What a delivery takes beside its bytes while it waits, or is kept, about: many small ones are bounded too."""


class Turns:
    """Does work in the order in which it came.

    Args:
        now: The time in nanoseconds. Where it stands still all is done at once.
        failed: Called with what a step raised.
        turn_ns: Nanoseconds of each turn.
    """

    def __init__(self, now: Callable[[], int], failed: Callable[[Exception], None], turn_ns: int = TURN_NS) -> None:
        self.size: int = 0  # of all that waits
        self._now = now
        self._failed = failed
        self._turn_ns = turn_ns
        # The work that waits, and its size as it was given to `add`.
        self.waiting: deque[tuple[Iterator[None], int]] = deque()
        # Whether it is being done, or another turn of the loop was asked for.
        self._busy = False

    def add(self, steps: Iterable[None], size: int = 0) -> None:
        """Do this behind what waits; at once, as far as the time of this turn goes, where nothing does."""
        self.waiting.append((iter(steps), size))
        self.size += size
        if not self._busy:
            self._go_on()

    def _go_on(self) -> None:
        """Do what waits, as far as the time of this turn of the loop goes; later turns go on with it."""
        began = now = self._now()
        self._busy = True
        try:
            while self.waiting:
                steps, size = self.waiting[0]
                for _ in steps:
                    now = self._now()
                    if now - began >= self._turn_ns:
                        return
                self.waiting.popleft()
                self.size -= size
        except Exception as error:
            self.size -= self.waiting.popleft()[1]
            self._failed(error)
        finally:
            # What else is to be done in a turn whose time is mostly over is done in the next one, too.
            self._busy = bool(self.waiting) or now - began > self._turn_ns // 2
            if self._busy:
                asyncio.get_running_loop().call_soon(self._go_on)
