"""Waiting for another thread in a way that Ctrl-C may end anywhere.

`threading.Event`, `Condition` and `concurrent.futures.Future` are made of locks that Python code takes and gives
back. Ctrl-C raises `KeyboardInterrupt` in the midst of that code: the lock stays taken, or is given back twice, and
the other thread waits for ever or fails. Here each waiter has a plain lock of its own, which the interpreter waits
for in one piece, and what threads share is changed in one piece too.
"""

import _thread
import sys
import threading
from collections import deque
from collections.abc import Callable

_WAIT_S = 0.2 if sys.platform == "win32" else -1.0
"""On Windows Ctrl-C does not end a wait that has no limit, so the wait is divided."""


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

    def wait(self) -> None:
        """Wait until it has happened."""
        waiter = threading.Lock()
        waiter.acquire()
        self._waiters.append(waiter)
        # Looked at behind the line above: `set` finds the waiter, or the waiter finds that it is set.
        while not (self.is_set or waiter.acquire(timeout=_WAIT_S)):
            pass


def start_apart(start: Callable[[], object], failed: Callable[[Exception], object]) -> None:
    """Have another thread call `start`, which starts a thread: `Thread.start` waits by a Condition.

    Where the system allows no more threads, or no memory is left for one, `failed` is called instead.
    """

    def run() -> None:
        try:
            start()
        except (RuntimeError, MemoryError) as error:
            failed(error)

    try:
        _thread.start_new_thread(run, ())
    except (RuntimeError, MemoryError) as error:
        failed(error)
