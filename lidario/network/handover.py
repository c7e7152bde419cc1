"""From a thread of zenoh to the event loop: bounded in bytes while it waits, and in time in each turn of the loop.

No lock is needed: adding to a deque and taking from it are atomic, and each counter is changed by one thread.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Final, Generic, TypeVar

__all__ = ["ITEM_BYTES", "MOST_AT_ONCE", "MOST_WAITING_BYTES", "TURN_NS", "Handover"]

T = TypeVar("T")

MOST_WAITING_BYTES: Final = 8 << 20
"""What waits for the event loop, of one subscription: a second of 25 lidars that send whole scans, or of a hundred
that send raw bytes. How many messages that is says little."""
ITEM_BYTES: Final = 512
"""What an item takes beside its bytes, about, so that empty ones are bounded too."""
TURN_NS: Final = 5_000_000
"""Nanoseconds of each turn of the loop; `lidario.port.turns` may take its own beside it."""
MOST_AT_ONCE: Final = 256
"""Items in one turn of the loop, where all of them take less than that."""


class Handover(Generic[T]):
    """Items on their way to the event loop.

    Args:
        take: Called with each of them, on the event loop. What it returns is work in steps that belongs to it.
        wake: Has the event loop call something soon, from any thread.
        again: The same, from the event loop's own thread.
    """

    def __init__(
        self,
        take: Callable[[T], Iterable[None] | None],
        wake: Callable[[Callable[[], None]], object],
        again: Callable[[Callable[[], None]], object],
    ) -> None:
        self._take = take
        self._wake = wake
        self._again = again
        # Whether the loop was asked to take items and has not taken all; set by both threads. The other one is the
        # loop's own: whether it will come back by itself.
        self._is_due = False
        self._comes_back = False
        self._waiting: deque[tuple[T, int]] = deque()
        self._put = self._taken = 0
        self._work: Iterator[None] | None = None

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
            self._wake(self._asked)
        return dropped

    def _asked(self) -> None:
        if not self._comes_back:
            self._turn()

    def _turn(self) -> None:
        self._comes_back = False
        # Where `take` raises, the next item that is added asks again.
        self._is_due = False
        if self._hand_over():
            self._is_due = self._comes_back = True
            self._again(self._turn)

    def _hand_over(self) -> bool:
        """Have items taken, as many as one turn may; returns whether some may be left."""
        until = time.monotonic_ns() + TURN_NS
        for _ in range(MOST_AT_ONCE):
            if self._work is None:
                try:
                    item, size = self._waiting.popleft()
                except IndexError:  # none was left, or zenoh's thread has dropped it
                    return False
                self._taken += size
                self._work = iter(self._take(item) or ())
            if not self._goes_to_its_end(self._work, until) or time.monotonic_ns() >= until:
                return True
        return True

    def _goes_to_its_end(self, work: Iterator[None], until: int) -> bool:
        for _ in work:
            if time.monotonic_ns() >= until:
                return False
        self._work = None
        return True
