"""What the operation in progress waits for: one future, so that everything that may end the waiting can do so.

One operation at a time talks to the device, and it waits for one thing at a time: a response, a pause, or a change
of what the device is busy with. `Waiting.interrupt`, a dead port and the end of the session end that at once.
Timers, not cancel scopes, bound it: native cancellation and anyio's behave alike.
"""

import asyncio
import weakref
from collections.abc import Callable
from enum import Enum, auto

from lidario.errors import LidarError
from lidario.session.talking.trouble import to_be_kept, twin_of


class Awaited(Enum):
    """What an operation waits for."""

    TIME = auto()
    RESPONSE = auto()
    CHANGE = auto()


class Waiting:
    """The one future of the operation in progress; a base of `Dialogue`."""

    def __init__(self) -> None:
        self.fatal: LidarError | None = None  # what ended all operations for good, or None
        self._loop = asyncio.get_running_loop()
        # Held by its task and its timer. A finalizer reaches this object, and must not reach the frames of a task.
        self._waiter: Callable[[], asyncio.Future[bytes | None] | None] = lambda: None
        self._awaited = Awaited.TIME
        # What ends the operation in progress, or every one.
        self._ends: LidarError | None = None

    def interrupt(self, error: LidarError) -> None:
        """End the operation in progress with `error`: at once if it waits, else at its next step."""
        self._ends = self.fatal or error
        waiter = self._waiter()
        if waiter is not None and not waiter.done() and not self._loop.is_closed():
            waiter.set_exception(twin_of(error))

    def end(self, error: LidarError) -> None:
        """End all operations with `error`, from any thread; one that waits ends by `interrupt`, or by its time."""
        to_be_kept(error)
        self.fatal = self._ends = error

    async def wait(self, seconds: float, what: Awaited = Awaited.TIME) -> bytes | None:
        """Wait for `what`, and return what it is woken with; None when the time is up.

        `interrupt` and a dead port end it.
        """
        if self._ends is not None:
            raise twin_of(self._ends)
        waiter: asyncio.Future[bytes | None] = self._loop.create_future()
        self._waiter, self._awaited = weakref.ref(waiter), what
        timer = self._loop.call_later(seconds, _time_out, waiter)
        try:
            return await waiter
        finally:
            timer.cancel()

    def wake(self, what: Awaited, result: bytes = b"") -> None:
        """The operation in progress need not wait any more, if it waits for this."""
        waiter = self._waiter() if self._awaited is what else None
        # After the loop was closed, waiters are collected: none can be woken any more.
        if waiter is not None and not waiter.done() and not self._loop.is_closed():
            waiter.set_result(result)


def _time_out(waiter: asyncio.Future[bytes | None]) -> None:
    if not waiter.done():
        waiter.set_result(None)
