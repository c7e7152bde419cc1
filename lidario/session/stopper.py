"""Leaving the device still: which requests do it, when they are written, and what follows.

The stop requests are written once, at the first moment at which the device listens. Mostly that is now: then they
have reached the operating system before `stop` returns. Else a timer writes them, which no cancellation reaches.
A response that is outstanding is waited for no longer than `PATIENCE_S`. While nothing was sent since that could
set the device in motion, it is still, and they are not written again.

When the session ends, the line is listened to after them: a device that goes on sending has not heard them, and
they are written again before the port is closed. A device that only talks has stop requests without bytes: for it
there is nothing to write and nothing to wait for.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from lidario.errors import Unsupported
from lidario.families.base import Device
from lidario.wire.envelope import Request

__all__ = ["CLOCK_S", "PATIENCE_S", "Stopper", "Writer"]

_log = logging.getLogger("lidario")

PATIENCE_S = 0.1
"""How long the stop requests wait for a response that is outstanding. Healthy devices respond within a few
milliseconds; one that does not may be unable to, and its motor must not go on turning for that."""
CLOCK_S = 1e-6
"""A timer may fire that little early, by the resolution of the loop's clock: its time has come all the same."""
ATTEMPTS = 3
"""How often the stop requests are written when bytes go on coming after them, before the port is closed anyway."""


class Writer(Protocol):
    """What a `Stopper` needs of the dialogue."""

    @property
    def is_open(self) -> bool:
        """Whether requests can still be written."""
        ...

    @property
    def bytes_received(self) -> int:
        """All bytes that came in so far."""
        ...

    def free_at(self, patient_until: float) -> float:
        """When the device listens, on the loop's clock; a response is not waited for beyond `patient_until`."""
        ...

    def write(self, requests: Sequence[Request]) -> None:
        """Write requests now."""
        ...

    def close_port(self) -> None:
        """Begin to close the port."""
        ...


class Stopper:
    """Writes the stop requests of one device.

    Attributes:
        keep_spinning: Whether they leave the motor on.
        still: Whether they have been written, and nothing since that could set the device in motion.
        wanted: Whether they are still to be written.
        on_still: Called each time they have been written.
    """

    def __init__(self, writer: Writer, device: Device, quiet_s: float) -> None:
        self.keep_spinning: bool = False
        self.still: bool = False
        self.wanted: bool = False
        self.on_still: Callable[[], None] | None = None
        self._writer = writer
        self._device = device
        self._quiet_s = quiet_s
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._due = 0.0
        self._patient_until = 0.0
        self._hanging_up = False
        try:
            self._reset = device.reset().data
        except Unsupported:
            self._reset = b""

    @property
    def ends_by_itself(self) -> bool:
        """Whether the stop requests are written, or have a timer, and the port is closed after them."""
        return self._hanging_up and (self.still or self._timer is not None)

    def requests(self) -> tuple[Request, ...]:
        """What leaves the device still: laser off, and the motor too unless it shall go on. Chosen here alone."""
        return (self._device.stop(),) if self.keep_spinning else self._device.halt()

    def sent(self, request: Request) -> None:
        """Take note that `request` was sent: it may have set the device in motion.

        Queries do not, and a reset leaves the device as after power-up: it booted, and hears nothing meanwhile.
        """
        if request.stream is not None or (request.expects is None and not request.ends_stream):
            self.still = False
        elif self.is_reset(request):
            self.still = True

    def is_reset(self, request: Request) -> bool:
        """Whether the device boots after `request`; one that cannot be restarted from here never does."""
        return bool(self._reset) and request.data == self._reset

    def stop(self) -> None:
        """Write the stop requests as soon as the device listens, now if it does. Never blocks or raises."""
        if self.still or self.wanted or not self._writer.is_open or self._loop.is_closed():
            return
        self.wanted = True
        self._patient_until = self._loop.time() + PATIENCE_S
        self.try_now()

    def try_now(self) -> None:
        """Write the stop requests if they are wanted and the device listens; else come back when it does."""
        if not self.wanted:
            return
        self.cancel()
        due = self._writer.free_at(self._patient_until)
        if due - self._loop.time() > CLOCK_S:
            # Not asked of the timer later: uvloop's shortest ones do not know when they are due.
            self._due = due
            self._timer = self._loop.call_at(due, self.try_now)
            return
        self._write()
        if self.on_still is not None:
            self.on_still()
        if self._hanging_up and any(request.data for request in self.requests()):
            self._close_when_quiet(ATTEMPTS)
        elif self._hanging_up:
            # A device that streams unasked was told nothing, and does not fall quiet.
            self._writer.close_port()

    async def written(self) -> None:
        """Return when the stop requests are written, or the port is dead; after 0.6 s at most."""
        # A timer that is late or put off makes another round; nothing can wake this too early or never.
        while self.wanted and self._timer is not None and self._writer.is_open:  # noqa: ASYNC110
            await asyncio.sleep(max(0.0, self._due - self._loop.time()))

    async def surely_written(self) -> None:
        """As `written`; a cancellation that comes meanwhile is raised afterwards.

        The program may close the loop as soon as it goes on, and no timer writes anything after that.
        """
        cancelled: asyncio.CancelledError | None = None
        while self.wanted and self._timer is not None and self._writer.is_open:
            try:
                await self.written()
            except asyncio.CancelledError as error:
                cancelled = error
        if cancelled is not None:
            raise cancelled

    def hang_up(self) -> None:
        """Leave the device still, then close the port; without waiting, timers go on with it."""
        if self._hanging_up:
            return
        self._hanging_up = True
        if self.still or not self._writer.is_open:
            self._writer.close_port()
        else:
            self.stop()

    def cancel(self) -> None:
        """Stop the timer: nothing is written any more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _write(self) -> None:
        self.wanted = False
        # Each of them ends the stream for the parser, also the one that is for the motor alone.
        self._writer.write([replace(request, ends_stream=True) for request in self.requests()])
        self.still = True

    def _close_when_quiet(self, attempts: int) -> None:
        """Close the port once the line is quiet after the stop requests; write them again while it is not."""
        self._timer = self._loop.call_at(self._writer.free_at(0.0), self._listen, attempts)

    def _listen(self, attempts: int) -> None:
        seen = self._writer.bytes_received
        self._timer = self._loop.call_later(self._quiet_s, self._after_listening, attempts, seen)

    def _after_listening(self, attempts: int, seen: int) -> None:
        self._timer = None
        if self._writer.bytes_received != seen and attempts > 1:
            self._write()
            self._close_when_quiet(attempts - 1)
            return
        if self._writer.bytes_received != seen:
            _log.warning("the device goes on sending after %d stop requests", ATTEMPTS)
        self._writer.close_port()
