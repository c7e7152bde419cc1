"""From a thread of zenoh to the event loop: bounded in bytes while it waits, and in time in each turn of the loop.

No lock is needed: adding to a deque and taking from it are atomic, and each counter is changed by one thread.
"""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Final, Generic, NoReturn, TypeVar

from lidario.port.turns import Turns

T = TypeVar("T")

MOST_WAITING_BYTES: Final = 8 << 20
"""What waits for the event loop, of one subscription: a second of 25 lidars that send whole scans, or of a hundred
that send raw bytes. How many messages that is says little."""
ITEM_BYTES: Final = 512  # what an item takes beside its bytes, about, so that empty ones are bounded too
TURN_NS: Final = 5_000_000  # nanoseconds of each turn of the loop; the bytes of a port may take their own beside it


class Handover(Generic[T]):
    """Items on their way to the event loop.

    Args:
        take: Called with each of them, on the event loop. What it returns is work in steps that belongs to it.
        wake: Has the event loop call something soon, from any thread.
    """

    def __init__(
        self, take: Callable[[T], Iterable[None] | None], wake: Callable[[Callable[[], None]], object]
    ) -> None:
        self._take = take
        self._wake = wake
        self._is_due = False  # whether the loop was asked to take items and has not begun; set by both threads
        self._waiting: deque[tuple[T, int]] = deque()
        self._put = self._taken = 0
        self._turns = Turns(time.monotonic_ns, _fail, TURN_NS)

    def put(self, item: T, size: int) -> int:
        """Add an item of so many bytes, in zenoh's thread; returns how many were dropped for it."""
        dropped = 0
        size += ITEM_BYTES
        self._waiting.append((item, size))
        self._put += size
        while self._put - self._taken > MOST_WAITING_BYTES and len(self._waiting) > 1:
            with suppress(IndexError):  # the loop was faster
                self._put -= self._waiting.popleft()[1]
                dropped += 1
        if not self._is_due:
            self._is_due = True
            self._wake(self._hand_over)
        return dropped

    def _hand_over(self) -> None:
        self._turns.add(self._all())

    def _all(self) -> Iterator[None]:
        """Have all that waits taken. Where `take` raises, the next item that is added asks again."""
        self._is_due = False
        while True:
            try:
                item, size = self._waiting.popleft()
            except IndexError:  # none was left, or zenoh's thread has dropped it
                return
            self._taken += size
            yield from self._take(item) or ()
            yield


def _fail(error: Exception) -> NoReturn:
    """To the event loop, which tells of it."""
    raise error
