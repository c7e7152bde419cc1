"""A request that must be repeated while a stream runs, written by the reading thread where the loop is late.

Some devices stop when their host falls silent. The event loop writes what keeps them going; while the program
blocks the loop, nothing would be written. Then `lidario.port.thread` writes it, from another thread.

A repeat that came after the stop requests would start the device again. So `Repeat.stop` is called before they are
written, and no write is in progress when it returns.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

__all__ = ["Repeat", "Repeated"]

LEAST_REST_S = 0.01
"""Shortest time between two looks of the thread; a clock that stands still must not keep it busy."""
_UNSHOWN = 256
"""Writes that are kept for the taps; more than are made in the longest time for which bytes are kept."""


class Repeat:
    """One request, and when it was written last.

    Args:
        handle: File descriptor of the terminal, non-blocking.
        request: The bytes to write.
        interval: Seconds after the last write, by whichever thread, after which `serve` writes.
        clock: The time in nanoseconds.
        write: Writes to a descriptor.

    Attributes:
        request: The bytes to write.
        count: How often `serve` has written it.
    """

    def __init__(
        self,
        handle: int,
        request: bytes,
        interval: float,
        clock: Callable[[], int],
        write: Callable[[int, bytes], int] = os.write,
    ) -> None:
        self.request: bytes = request
        self.count: int = 0
        self._handle = handle
        self._interval_ns = round(interval * 1e9)
        self._clock = clock
        self._write = write
        self._written_ns = clock()
        self._unshown: deque[tuple[bytes, int]] = deque(maxlen=_UNSHOWN)
        # Reentrant: the garbage collector may call `stop` in the midst of `serve`.
        self._lock = threading.RLock()
        self._stopped = False

    def note(self) -> None:
        """The loop has just written it."""
        self._written_ns = self._clock()

    def serve(self) -> None:
        """Write it if the loop is late with it. Never raises: the loop finds the same error."""
        with self._lock:
            now = self._clock()
            if self._stopped or now - self._written_ns < self._interval_ns:
                return
            self._written_ns = now
            with suppress(OSError):
                self._write(self._handle, self.request)
                self.count += 1
                self._unshown.append((self.request, now))

    def take_written(self) -> list[tuple[bytes, int]]:
        """What `serve` has written since the last call, and when."""
        with self._lock:
            written = list(self._unshown)
            self._unshown.clear()
            return written

    def next_at(self, now: float) -> float:
        """When to call `serve` again, in seconds of a clock that says `now`."""
        rest_ns = self._written_ns + self._interval_ns - self._clock()
        return now + max(rest_ns * 1e-9, LEAST_REST_S)

    def stop(self) -> None:
        """Write it no more; a write in progress in another thread has ended when this returns."""
        with self._lock:
            self._stopped = True


class Repeated:
    """A line that the reading thread only writes to: an event loop reads it, and its buffer is large.

    Args:
        repeat: What is written.
    """

    def __init__(self, repeat: Repeat) -> None:
        self._repeat = repeat

    def serve(self, now: float, late: float) -> float:  # noqa: ARG002
        self._repeat.serve()
        return self._repeat.next_at(now)
