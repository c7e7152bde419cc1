"""Reading a terminal or a socket: when to read, and how long to keep what was read.

Being woken for each delivery of an adapter, a thousand a second, costs more than decoding what they carry. While a
stream runs, the line is polled instead, at the times that a `Schedule` names, and what was read is held until
it is needed. Between two polls, and while the program keeps the event loop busy, `lidario.port.thread` reads it.

Where each delivery does matter, the event loop wakes the reader when the line is readable. On Windows not every
event loop can do that; there the line is polled always.
"""

import asyncio
import os
import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from lidario.port.inbox import TERMINAL, Inbox, Kind, Read
from lidario.port.line import Line, Schedule
from lidario.port.port import Port
from lidario.port.thread import Repeat, Watched, reading_thread

HOLD_S = 0.5
"""Longest time for which bytes are held; below the 0.6 s after which the session takes silence for a failure
(`lidario.session.streaming.running.SILENCE_S`)."""
HOLD_BYTES = 32 * 1024
"""Most bytes that are held."""
_JUST_BEFORE_S = 1e-5
"""A poll that comes that little early is in time: much less than a packet takes, and more than the resolution of a
clock."""
_TIMER_S = 0.001
"""How late timers may be: the loop waits in whole milliseconds, rounded up."""
_POLL_S = 0.002
"""Time between two polls where each delivery matters and the event loop cannot wait for it; Windows may make 16 ms
of it."""
ALONE_SHARE = 0.7
"""Share of the system's buffer that may fill between two polls where no thread helps."""


class PolledLine(Line):
    """A line of the system, as it is read; the base of those of serial ports and sockets.

    Its `handle` does not block; it is below 0 where the event loop cannot wait for it, and then `read` reads it.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        port: Port,
        handle: int,
        write: Callable[[bytes], int],
        read: Read | None = None,
        kind: Kind = TERMINAL,
    ) -> None:
        self._loop = loop
        self._port = port
        self._handle = handle
        self._write_now = write  # returns how many bytes the system took; raises OSError where it took none
        self._schedule: Schedule | None = None
        self._running = False
        self._error: Exception | None = None  # why it turned out to be dead
        self._watching = False
        self._timer: asyncio.TimerHandle | None = None
        clock = time.monotonic_ns if port.is_real_time else port.now
        self._inbox = Inbox(handle, clock, read, port.late, kind)
        # What the thread serves does not refer to the line: one that is dropped is not read and written for ever.
        self.repeat: Repeat | None = Repeat(write) if port.is_real_time else None
        failing = partial(_failing, loop, weakref.WeakMethod(self.lose))
        self._watched = Watched(self._inbox, 0.0, failing)
        # While the thread watches. It may be run in any thread at any moment, so there is none of a line at rest.
        self._dropped: weakref.finalize[..., PolledLine] | None = None

    def lose(self, error: Exception) -> None:
        """The line turns out to be dead. Ignored where it is closed, and in a forked child."""
        if not self.is_closing and not self._port.is_forked:
            self._error = error
            self.abort()

    def _write_some(self, data: bytes) -> bytes:
        """Write what the system takes; return the rest, none of a line that turns out to be dead."""
        try:
            return data[self._write_now(data) :]
        except BlockingIOError:
            return data
        except OSError as error:
            self.lose(error)
            return b""

    def start(self) -> None:
        """Begin to read; ignored when `stop` was called before."""
        if not self.is_closing:
            self._running = True
            self._wait()

    def stop(self) -> None:
        """Stop reading. What is held stays for `hand_over`."""
        self._running = False
        self.is_closing = True
        self._watch(False)
        self.release()

    def release(self) -> None:
        """Stop reading, also in the thread: from now on the descriptor may be closed."""
        if self.repeat is not None:
            self.repeat.set(b"")
        if not self._port.is_forked:
            self._watch_in_thread(None)
            self._inbox.close()

    def set_polling(self, schedule: Schedule | None) -> None:
        """Poll by this schedule from now on, as `Port.set_polling` describes; a thread helps where it is late."""
        self._schedule = schedule
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._watch_in_thread(schedule)
        if self._inbox.size:
            self.hand_over()
        self._wait()

    def poll(self) -> None:
        """Read what is there now, and hand over everything that is held."""
        self._read()
        self.hand_over()

    def hand_over(self) -> None:
        held, arrivals = self._inbox.take()
        if held:
            self._port.data_received(b"".join(held), arrivals.pop()[1], arrivals)

    def _poll(self) -> None:
        """A poll is due, or the event loop says that there is something to read."""
        if self._port.is_forked:
            return
        self._timer = None
        inbox, schedule = self._inbox, self._schedule
        try:
            self._read()
            now = inbox.last_ns * 1e-9
            held_long = now >= inbox.first_ns * 1e-9 + HOLD_S
            if schedule is None or held_long or inbox.size >= HOLD_BYTES or schedule.due - now <= _JUST_BEFORE_S:
                self.hand_over()
        finally:
            self._wait()

    def _read(self) -> None:
        """Read all there is; nothing behind `stop`, which has closed the inbox."""
        try:
            self._inbox.read()
        except OSError as error:
            self.lose(error)

    def _wait(self) -> None:
        """Wait for the next poll, or be woken by the next delivery where none of them may wait."""
        schedule, pause = self._schedule, 0.0
        if not self._running or self._timer is not None or (self._watching and schedule is None):
            return
        if schedule is not None:
            now_ns = self._port.now()
            now = now_ns * 1e-9
            pause = min(schedule.due, (self._inbox.first_ns or now_ns) * 1e-9 + HOLD_S) - now
            if self._dropped is not None:
                self._watched.buffer_s = schedule.buffer_s
                reading_thread().put_off()
            else:
                pause = min(pause, ALONE_SHARE * schedule.buffer_s)
            if pause <= 0:
                pause = max(schedule.latency - _TIMER_S, schedule.latency / 2)
        if pause <= 0 and self._handle < 0:
            pause = _POLL_S
        if pause <= 0:
            self._watch(True)
            if self._inbox.size:
                self.hand_over()
            return
        self._watch(False)
        self._timer = self._loop.call_later(pause, self._poll)

    def _watch(self, on: bool) -> None:
        if on is not self._watching:
            if on:
                self._loop.add_reader(self._handle, self._poll)
            else:
                self._loop.remove_reader(self._handle)
            self._watching = on

    def _watch_in_thread(self, schedule: Schedule | None) -> None:
        """Have the thread read beside the loop while there is a schedule; None for no longer."""
        if self._dropped is not None:
            reading_thread().remove(self._watched)
            self._dropped.detach()
            # What the thread has read is in the inbox now; a response that comes next must not lie there unseen.
            self._inbox.share(False)
        # Not earlier: Ctrl-C may come anywhere above, and then `stop` removes it.
        self._dropped = None
        if schedule is not None and self._port.is_real_time and not self.is_closing:
            self._inbox.share(True)
            # Noted before it is read, as above.
            self._watched.buffer_s = schedule.buffer_s
            dropped = self._dropped = weakref.finalize(self, _forget, self._watched, self.repeat, os.getpid())
            dropped.atexit = False
            try:
                reading_thread().add(self._watched)
            except RuntimeError:
                # A system that allows no more threads: the loop polls more often instead.
                dropped.detach()
                self._dropped = None


def _failing(
    loop: asyncio.AbstractEventLoop, lose: weakref.WeakMethod[Callable[[Exception], None]], error: OSError
) -> None:
    """In the thread, which could not read a line: the loop ends it."""
    callback = lose()
    if callback is not None:
        with suppress(RuntimeError):  # the loop was closed
            loop.call_soon_threadsafe(callback, error)


def _forget(watched: Watched, repeat: Repeat | None, pid: int) -> None:
    """The line is garbage, and its terminal will be closed; in a forked child it is the parent's."""
    if os.getpid() == pid:
        watched.inbox.close()
        reading_thread().remove(watched)
        if repeat is not None:
            repeat.set(b"")
