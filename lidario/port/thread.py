"""A thread that reads serial ports and sockets while the program keeps its event loop busy.

The kernel keeps 4 KiB of a terminal's input, 61 ms of the fastest stream, and drops what comes then. A program that
computes for longer on its event loop would lose bytes. So while a stream runs, this thread reads each port that
was not read for `Watched.interval`. It only moves bytes into the port's `Inbox` and notes when they came. The
event loop takes them from there when it needs them, at the end of a revolution, and reads what came since. On a
loop that is free no thread wakes the other one; a loop that is late finds everything in the inbox. What must be
written again and again to keep a device going, and the loop is late with, is written likewise
(`lidario.port.repeat`).

The thread goes its own steps, of one interval each, and does not look whether the loop was in time: at 10 Hz and an
interval of 43 ms it would be woken three times a revolution for that, and so it is woken 2.3 times.

One thread reads all ports of the process. It starts with the first stream and ends with the last. It is a daemon
thread, so it never keeps a program from ending. A forked child has no such thread and starts its own when it opens
a port of its own.

C code that keeps the interpreter lock for longer stops this thread too.
"""

from __future__ import annotations

import _thread
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Protocol

from lidario.latch import Latch
from lidario.port.inbox import Inbox

RECENT_SHARE = 0.15
"""Share of the interval: a port that the loop has read that recently is not read again now. The next step counts
from the loop's read then, and that share is lost: with 0.5 the thread is woken 2.5 times a revolution."""
TOGETHER_SHARE = 0.15
"""Share of the interval by which a port is read early, to read several at one wake-up."""
LATENESS_FACTOR = 2.0
"""Safety factor on the observed lateness of the thread: as long as it is very late, ports are read more often."""
RESERVE_SHARE = 0.1
"""Share of the interval by which a read may be late without ports being read more often. The kernel's buffer is
full after 1.43 intervals (`BUFFER_SHARE` of `Pace`). With 0.3 more was lost while a program
computed in Python and the machine was busy: the thread waits 5 ms for the interpreter then, and for a core."""
LEAST_SHARE = 0.25
"""Share of the interval below which ports are not read closer, however late the thread is."""
JOIN_S = 0.1
"""Longest time for which ending the thread is waited for. It takes less than a tenth of a millisecond."""
_FORGET = 0.95
"""Share of the greatest lateness that is remembered after another wake-up."""


def start_thread(work: Callable[[], None], name: str) -> threading.Thread:
    """Start a daemon thread, and return it when it has begun.

    Where Ctrl-C ends the waiting, the thread does its work all the same, or was never started. So `work` must find
    out itself whether anybody still needs it.

    Raises:
        RuntimeError: The system allows no more threads.
    """
    thread = threading.Thread(target=work, name=name, daemon=True)
    begun = Latch()
    failures: list[RuntimeError] = []

    def start() -> None:
        try:
            thread.start()
        except RuntimeError as error:
            failures.append(error)
        finally:
            begun.set()

    _thread.start_new_thread(start, ())
    begun.wait()
    if failures:
        raise failures[0]
    return thread


class Served(Protocol):
    """One port that the thread works for."""

    def serve(self, now: float, late: float) -> float:
        """Do what is due; return when to come back, in seconds of the monotonic clock.

        Args:
            now: The time.
            late: Seconds by which the next call may be late.
        """
        ...


class Watched:
    """One port that the thread reads.

    `on_error` is called in the thread each time the port cannot be read; it must not block or raise.
    """

    def __init__(self, inbox: Inbox, interval: float, on_error: Callable[[OSError], None]) -> None:
        self.interval: float = interval  # may be changed at any time, from any thread
        self.inbox: Inbox = inbox
        self._on_error = on_error
        self._next_at = 0.0

    def serve(self, now: float, late: float) -> float:
        """As `Served`: read the port if it is due."""
        interval = self.interval
        if now >= self._next_at - TOGETHER_SHARE * interval:
            last = self.inbox.last_ns * 1e-9
            unread = interval - max(0.0, late - RESERVE_SHARE * interval)
            unread = max(unread, LEAST_SHARE * interval)
            if now - last >= RECENT_SHARE * unread:
                try:
                    self.inbox.read(from_thread=True)
                except OSError as error:
                    # The loop cannot read it again: a socket tells an error once.
                    self._on_error(error)
                    self._next_at = now + interval
                    return self._next_at
                last = self.inbox.last_ns * 1e-9
            self._next_at = last + unread
        return self._next_at


class ReadingThread:
    """The thread, and the ports that it serves.

    Args:
        clock: The time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        # Reentrant: the garbage collector may call `remove` during `add`.
        self._lock = threading.RLock()
        self.ports: list[Served] = []  # those that it serves now; `add` and `remove` change that
        self._thread: threading.Thread | None = None
        self._late = 0.0
        # Released to wake the thread; a lock wakes it more cheaply and more exactly than an Event or a pipe.
        self._sleep = threading.Lock()
        self._sleep.acquire()
        self._woken = False

    def add(self, watched: Served) -> None:
        """Serve this port from now on; starts the thread where it does not run, as `start_thread`.

        Where Ctrl-C ends it, the port may be read all the same, until `remove` is called.
        """
        with self._lock:
            self.ports.append(watched)
            if self._thread is not None:
                self._wake()
                return
        # Not under the lock: garbage may be collected in a thread that starts, and then `remove` is called there.
        begun = Latch()
        try:
            start_thread(partial(self._run, begun), "lidario: read ports")
        except RuntimeError:
            self.remove(watched)
            raise
        begun.wait()

    def remove(self, watched: Served) -> None:
        """Stop serving this port; the last one ends the thread. Ignored where it is not there.

        The thread may still try to read it once; `Inbox.share` prevents that.
        """
        with self._lock:
            if watched not in self.ports:
                return
            self.ports.remove(watched)
            if self.ports:
                return
            self._wake()
            thread = self._thread
        # The garbage collector may call this in the thread itself.
        if thread is not None and thread is not threading.current_thread():
            thread.join(JOIN_S)

    def _wake(self) -> None:
        if not self._woken:
            self._woken = True
            self._sleep.release()

    def _run(self, begun: Latch) -> None:
        with self._lock:
            # Another one serves the ports where two were started at once, or Ctrl-C has ended `add` early.
            is_needed = self._thread is None
            if is_needed:
                self._thread = threading.current_thread()
        begun.set()
        if not is_needed:
            return
        while True:
            until = self.serve()
            if until is None:
                return
            if self._sleep.acquire(timeout=max(0.0, until - self._clock())):
                with self._lock:
                    self._woken = False
            else:
                self.note_lateness(self._clock() - until)

    def serve(self) -> float | None:
        """Read the ports that are due; return when the next one is, or None when none is left.

        Then the thread must end: the next `add` starts another one.
        """
        late = LATENESS_FACTOR * self._late
        now = self._clock()
        dues = [watched.serve(now, late) for watched in self.ports.copy()]
        if dues:
            return min(dues)
        with self._lock:
            if self.ports:
                return now
            self._thread = None
            if self._woken:
                self._woken = False
                self._sleep.acquire()
            return None

    def note_lateness(self, late: float) -> None:
        """Take note of how late the thread woke up, in seconds."""
        self._late = max(late, _FORGET * self._late)


class _Process:
    """The thread of this process."""

    thread = ReadingThread()


def reading_thread() -> ReadingThread:
    """The one thread of this process; in a forked child, one that knows no port."""
    return _Process.thread


def _forget_parent() -> None:
    _Process.thread = ReadingThread()


with suppress(AttributeError):  # not on Windows
    os.register_at_fork(after_in_child=_forget_parent)
