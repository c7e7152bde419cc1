"""A thread that reads serial ports and sockets while the program keeps its event loop busy.

The kernel keeps 4 KiB of a terminal's input, 61 ms of the fastest stream, and drops what comes then. A program that
computes for longer on its event loop would lose bytes. So while a stream runs, this thread reads each port just
before the buffer fills (`Watched.buffer_s`). It only moves bytes into the port's `Inbox` and notes when they came.
The event loop takes them from there when it needs them, at the end of a revolution, and reads what came since. No
thread wakes the other one: a loop that is late finds everything in the inbox, and one that has read puts off the
alarm for which the thread sleeps (`lidario.port.alarm`). So the thread wakes where it is needed: twice in a
revolution of 100 ms of the fastest stream, never where the buffer holds a whole one. What must be written again and
again to keep a device going, and the loop is late with, is written likewise (`Repeat`).

One thread reads all ports of the process. It starts with the first stream and ends with the last. It is a daemon
thread, so it never keeps a program from ending. A forked child has no such thread and starts its own when it opens
a port of its own.

C code that keeps the interpreter lock for longer stops this thread too.
"""

import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Protocol

from lidario.port.alarm import Alarm, make_alarm
from lidario.port.background import start_thread
from lidario.port.inbox import Inbox
from lidario.port.latch import Latch

TOGETHER_S = 0.006
"""How much earlier than it must be a port is read, to read several at one wake-up."""
LATENESS_FACTOR = 3.0
"""Safety factor on the observed lateness of the thread: as long as it is late, ports are read more often."""
RESERVE_SHARE = 0.3
"""Share of the buffer that is kept free in any case: bytes come in bursts, also just behind a read.
With 0.15 a revolution of 100 ms of the fastest stream takes one wake-up and not two, but an S2 lost up to 300 bytes
behind a blocked loop, on a machine that was not busy."""
FEW_PORTS = 8
"""Of more than these one is always due soon: looking at all, each time that one was read, would save no wake-up."""
LEAST_SHARE = 0.2
"""Share of the buffer that may fill in any case, however late the thread is."""
JOIN_S = 0.1
"""Longest time for which ending the thread is waited for. It takes less than a tenth of a millisecond."""
_FORGET = 0.95
"""Share of the greatest lateness that is remembered after another wake-up."""
_UNSHOWN = 256
"""Writes that are kept for the taps; more than are made in the longest time for which bytes are kept."""


class Served(Protocol):
    """One port that the thread works for."""

    def due(self, late: float) -> float:
        """When it must be served, in seconds of the monotonic clock, by a thread that may be late by so many."""
        ...

    def serve(self, now: float) -> None:
        """Do what is due. `due` tells a later time then."""
        ...


class Watched:
    """One port that the thread reads.

    `on_error` is called in the thread each time the port cannot be read; it must not block or raise.
    """

    def __init__(self, inbox: Inbox, buffer_s: float, on_error: Callable[[OSError], None]) -> None:
        # Seconds in which the system's buffer fills; may be changed at any time, from any thread.
        self.buffer_s: float = buffer_s
        self.inbox: Inbox = inbox
        self._on_error = on_error
        self._tried = 0.0

    def due(self, late: float) -> float:
        """As `Served`: before the buffer is full. The thread may have to wait for the interpreter."""
        reserve = max(late + sys.getswitchinterval(), RESERVE_SHARE * self.buffer_s)
        reserve = min(reserve, (1 - LEAST_SHARE) * self.buffer_s)
        return max(self.inbox.last_ns * 1e-9, self._tried) + self.buffer_s - reserve

    def serve(self, now: float) -> None:
        """As `Served`: read the port."""
        self._tried = now
        try:
            self.inbox.read(from_thread=True)
        except OSError as error:
            # The loop cannot read it again: a socket tells an error once.
            self._on_error(error)


class Repeat:
    """A request that must be repeated while a stream runs; the thread writes it where the loop is late with it.

    Some devices stop when their host falls silent. One repeated behind the stop requests would start the device
    again: so `set` ends it before they are written, and no write is in progress when it returns. It refers to no
    line, so that one that is dropped is not kept.

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
        self._alarm: Alarm = Alarm()  # until the thread has its own

    def add(self, watched: Served) -> None:
        """Serve this port from now on; starts the thread where it does not run, as `start_thread`.

        Where Ctrl-C ends it, the port may be read all the same, until `remove` is called.
        """
        with self._lock:
            self.ports.append(watched)
            if self._thread is not None:
                self._alarm.set(self._clock())
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
            self._alarm.set(self._clock())
            thread = self._thread
        # The garbage collector may call this in the thread itself.
        if thread is not None and thread is not threading.current_thread():
            thread.join(JOIN_S)

    def put_off(self) -> None:
        """An event loop has read its port: where there are few, the thread may sleep until the next one is due."""
        with self._lock:
            if len(self.ports) <= FEW_PORTS:
                self._set_alarm()

    def _set_alarm(self) -> None:
        late = LATENESS_FACTOR * self._late
        self._alarm.set(min((each.due(late) for each in self.ports), default=self._clock()))

    def _run(self, begun: Latch) -> None:
        with self._lock:
            # Another one serves the ports where two were started at once, or Ctrl-C has ended `add` early.
            is_needed = self._thread is None
            if is_needed:
                self._thread = threading.current_thread()
                self._alarm = make_alarm()
        begun.set()
        while is_needed and self.serve() is not None:
            self._alarm.wait()
            self._late = max(self._clock() - self._alarm.at, _FORGET * self._late)

    def serve(self) -> float | None:
        """Read the ports that are due, and set the alarm for the next one: return when, or None when none is left.

        Then the thread must end: the next `add` starts another one.
        """
        late = LATENESS_FACTOR * self._late
        now = self._clock()
        for each in self.ports.copy():
            if each.due(late) <= now + TOGETHER_S:
                each.serve(now)
        with self._lock:
            if self.ports:
                self._set_alarm()
                return self._alarm.at
            self._thread = None
            self.forget_alarm()
            return None

    def forget_alarm(self) -> None:
        """The thread has ended; or this is a forked child, and it is the parent's."""
        # Never closed twice, wherever a fork comes.
        alarm, self._alarm = self._alarm, Alarm()
        alarm.close()


class _Process:
    """The thread of this process."""

    thread = ReadingThread()


def reading_thread() -> ReadingThread:
    """The one thread of this process; in a forked child, one that knows no port."""
    return _Process.thread


def _forget_parent() -> None:
    _Process.thread.forget_alarm()
    _Process.thread = ReadingThread()


with suppress(AttributeError):  # not on Windows
    os.register_at_fork(after_in_child=_forget_parent)
