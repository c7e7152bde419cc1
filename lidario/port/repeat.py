"""A request that must be repeated while a stream runs, written by the reading thread where the loop is late.

Some devices stop when their host falls silent. The event loop writes what keeps them going; while the program
blocks the loop, nothing would be written. Then `lidario.port.thread` writes it, from another thread.

A repeat that came after the stop requests would start the device again. So `Repeat.set` ends it before they are
written, and no write is in progress when it returns.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from lidario.port.thread import reading_thread

_UNSHOWN = 256
"""Writes that are kept for the taps; more than are made in the longest time for which bytes are kept."""


class Repeat:
    """What one line has written again and again, and when it was written last; the thread serves it beside ports.

    It refers to no line, so that one that is dropped is not kept.

    Args:
        write: Writes to the line; it never blocks.
        clock: The time in nanoseconds.
    """

    def __init__(self, write: Callable[[bytes], object], clock: Callable[[], int] = time.monotonic_ns) -> None:
        self.request: bytes = b""  # the bytes that are written now; none for nothing
        self.count: int = 0  # how often the thread has written
        self._write = write
        self._clock = clock
        self._unshown: deque[tuple[str, bytes, int]] = deque(maxlen=_UNSHOWN)
        # Reentrant: the garbage collector may call `set` in the midst of `serve`.
        self._lock = threading.RLock()

    def set(self, request: bytes, interval: float = 0.0) -> None:
        """As `Port.set_repeat`; a write in progress in the thread has ended when this returns."""
        with self._lock:
            self.request, self._interval_ns = request, round(interval * 1e9)
            self.note()
        reading_thread().remove(self)
        if request:
            with suppress(RuntimeError):  # the system allows no more threads: only the loop writes it
                reading_thread().add(self)

    def note(self) -> None:
        """The loop has just written it."""
        self._written_ns = self._clock()

    def due(self, late: float) -> float:  # noqa: ARG002 - it need not be exact
        """As `Served`."""
        return (self._written_ns + self._interval_ns) * 1e-9 if self.request else math.inf

    def serve(self, now: float) -> None:  # noqa: ARG002
        """As `Served`: write it if the loop is late with it. Never raises: the loop finds the same error."""
        with self._lock:
            now_ns = self._clock()
            if self.request and now_ns - self._written_ns >= self._interval_ns:
                self._written_ns = now_ns
                with suppress(OSError):
                    self._write(self.request)
                    self.count += 1
                    self._unshown.append(("out", self.request, now_ns))

    def take_written(self) -> list[tuple[str, bytes, int]]:
        """What the thread has written since the last call, as it is shown to taps."""
        with self._lock:
            written = list(self._unshown)
            self._unshown.clear()
            return written
