"""Waiting for another thread in a way that Ctrl-C may end anywhere.

`threading.Event`, `Condition` and `concurrent.futures.Future` are made of locks that Python code takes and gives
back. Ctrl-C raises `KeyboardInterrupt` in the midst of that code: the lock stays taken, or is given back twice, and
the other thread waits for ever or fails. Here each waiter has a plain lock of its own, which the interpreter waits
for in one piece, and what threads share is changed in one piece too.
"""

import _thread
import math
import sys
import threading
from collections import deque
from collections.abc import Callable

_PIECE_S = 0.2
"""A wait is divided into pieces where it has a limit; on Windows always, where Ctrl-C ends no other wait."""
_PIECES = 25
"""So long is waited for a thread to begin, which takes some microseconds. It is counted in pieces, not in seconds:
of the time for which the whole program is stopped, one piece at most is counted."""


class Latch:
    """Something that happens once, for which any number of threads may wait."""

    def __init__(self) -> None:
        self.is_set: bool = False  # whether it has happened
        self._waiters: deque[threading.Lock] = deque()

    def set(self) -> None:
        """It has happened: every wait ends. To be called once, and not where Ctrl-C may come."""
        self.is_set = True
        while self._waiters:
            self._waiters.popleft().release()

    def wait(self, pieces: float = math.inf) -> bool:
        """Wait until it has happened, for so many pieces of time at most; return whether it has."""
        piece_s = _PIECE_S if pieces < math.inf or sys.platform == "win32" else -1.0
        waiter = threading.Lock()
        waiter.acquire()
        self._waiters.append(waiter)
        # Looked at behind the line above: `set` finds the waiter, or the waiter finds that it is set.
        while pieces > 0 and not (self.is_set or waiter.acquire(timeout=piece_s)):
            pieces -= 1
        return self.is_set


def start_apart(start: Callable[[], object], failed: Callable[[Exception], object]) -> None:
    """Have another thread call `start`, which starts a thread, and wait for that here.

    `Thread.start` itself waits by a Condition. Where the system allows no more threads, or no memory is left for
    one, `failed` is called instead. A thread that finds no memory for its first step ends, and `Thread.start` waits
    for it for ever. So the wait has a limit here; behind it `failed` is called too. A thread that is so late may
    still begin then.
    """
    over = Latch()

    def run() -> None:
        try:
            start()
        except (RuntimeError, MemoryError) as error:
            failed(error)
        over.set()

    try:
        _thread.start_new_thread(run, ())
    except (RuntimeError, MemoryError) as error:
        failed(error)
        return
    if not over.wait(_PIECES):
        failed(MemoryError("a thread did not begin"))
