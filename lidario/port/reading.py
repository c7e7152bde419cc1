"""Reading a terminal: when to read, and how long to keep what was read.

Being woken for each delivery of an adapter, a thousand a second, costs more than decoding what they carry. While a
stream runs, the terminal is polled instead, at the times that a `Schedule` names, and what was read is held until
it is needed. Linux keeps 4 KiB of a terminal's input, 48 ms of the fastest stream; the schedule must not let that
fill.

Where each delivery does matter, the event loop wakes the reader when the terminal is readable. In both cases all
there is is read by one call.
"""

from __future__ import annotations

import asyncio
import os
import select
from collections.abc import Callable

from lidario.port.port import Port, Schedule

__all__ = ["Reader"]

HOLD_S = 0.5
"""Longest time for which bytes are held; below the 0.9 s after which the session takes silence for a failure."""
HOLD_BYTES = 32 * 1024
"""Most bytes that are held: what `Link` takes in one piece."""
_READ_SIZE = 65536
_TIMER_S = 0.001
"""How late timers may be: the loop waits in whole milliseconds, rounded up."""


class Reader:
    """Reads one terminal on the event loop; not on Windows.

    Args:
        loop: The event loop.
        port: Is shown each read and handed what was read.
        handle: File descriptor of the terminal, non-blocking.
        lose: Called when the terminal turns out to be dead.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, port: Port, handle: int, lose: Callable[[Exception], None]
    ) -> None:
        self._loop = loop
        self._port = port
        self._handle = handle
        self._lose = lose
        self._latency = 0.0
        self._schedule: Schedule | None = None
        self._running = False
        self._stopped = False
        self._watching = False
        self._timer: asyncio.TimerHandle | None = None
        self._due = 0.0
        self._held: list[bytes] = []
        self._arrivals: list[tuple[int, int]] = []

    def start(self) -> None:
        """Begin to read; ignored when `stop` was called before."""
        if not self._stopped:
            self._running = True
            self._wait()

    def stop(self) -> None:
        """Read no more. What is held stays for `hand_over`."""
        self._running = False
        self._stopped = True
        self._stop_timer()
        self._watch(False)

    def set_polling(self, latency: float, schedule: Schedule | None) -> None:
        """As `Port.set_polling`."""
        self._latency = latency
        self._schedule = schedule
        self._stop_timer()
        self.hand_over()
        self._wait()

    def poll(self) -> None:
        """Read what is there now, and hand over everything that is held."""
        self._read()
        self.hand_over()

    def hand_over(self) -> None:
        """Hand everything that is held to the port, as one piece."""
        if not self._held:
            return
        held, self._held = self._held, []
        arrivals, self._arrivals = self._arrivals, []
        data = held[0] if len(held) == 1 else b"".join(held)
        self._port.hand_over(data, arrivals.pop()[1], arrivals)

    def _tick(self) -> None:
        """A poll is due."""
        if self._port.is_forked:
            return
        self._timer = None
        late = max(0.0, self._port.now() * 1e-9 - self._due)
        try:
            self._read()
            self._hand_over_if_due()
        finally:
            self._wait(late)

    def _readable(self) -> None:
        """The event loop says that there is something to read."""
        if self._port.is_forked:
            return
        try:
            self._read()
            self._hand_over_if_due()
        finally:
            if self._schedule is not None:
                self._wait()

    def _read(self) -> None:
        """Read all there is. A terminal that is readable and yet has nothing to read was hung up."""
        if self._stopped:
            return
        try:
            data = os.read(self._handle, _READ_SIZE)
            if not data and _is_readable(self._handle):
                # Bytes that came between the two calls, or the end.
                data = os.read(self._handle, _READ_SIZE)
                if not data:
                    raise OSError("the line was hung up")
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(error)
            return
        if data:
            now = self._port.now()
            self._port.show("in", data, now)
            before = self._arrivals[-1][0] if self._arrivals else 0
            self._held.append(data)
            self._arrivals.append((before + len(data), now))

    def _hand_over_if_due(self) -> None:
        if not self._held:
            return
        if self._schedule is not None and self._arrivals[-1][0] < HOLD_BYTES:
            now = self._port.now() * 1e-9
            if now < self._held_until() and now < self._schedule.hold(now):
                return
        self.hand_over()

    def _held_until(self) -> float:
        """When what is held must be handed over; a timer may come that little early."""
        return self._arrivals[0][1] * 1e-9 + HOLD_S - _TIMER_S

    def _wait(self, late: float = 0.0) -> None:
        """Wait for the next poll, or be woken by the next delivery where none of them may wait."""
        if not self._running or self._timer is not None:
            return
        now = self._port.now() * 1e-9
        pause = 0.0 if self._schedule is None else self._schedule.rest(now, late)
        if pause <= 0:
            pause = max(self._latency - _TIMER_S, self._latency / 2)
        if pause <= 0:
            self._watch(True)
            self.hand_over()
            return
        if self._held:
            pause = max(0.0, min(pause, self._held_until() + _TIMER_S - now))
        self._watch(False)
        self._due = now + pause
        self._timer = self._loop.call_later(pause, self._tick)

    def _watch(self, on: bool) -> None:
        if on and not self._watching:
            self._loop.add_reader(self._handle, self._readable)
        elif self._watching and not on:
            self._loop.remove_reader(self._handle)
        self._watching = on

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _is_readable(handle: int) -> bool:
    if hasattr(select, "poll"):  # select() itself refuses file descriptors beyond 1023
        poll = select.poll()
        poll.register(handle, select.POLLIN)
        return bool(poll.poll(0))
    return bool(select.select([handle], [], [], 0)[0])
