"""What a port does for its guard: tells it what stops the device, before anything is written, and dismisses it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from lidario.port.guard import Guard, start_guard
from lidario.port.line import Line
from lidario.port.tapped import Tapped
from lidario.wire.envelope import Request

__all__ = ["Guarded", "Stops"]

Stops: TypeAlias = Callable[[], tuple[Sequence[Request], Sequence[Request], float]]
"""Gives the requests that leave the device still, those that may do so at the end, and when it listens at the
latest, on the monotonic clock."""


class Guarded(Tapped):
    """The base of `Port`: its guard.

    Args:
        name: What was opened, for messages.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._guard: Guard | None = None
        self._stops: Stops | None = None

    async def guard(self) -> None:
        """Have another process leave the device still when this one dies (`lidario.port.guard`).

        Ignored where the line has no descriptor that could be passed on: a simulated device in memory ends with its
        program. Cancelling leaves no process behind.

        Raises:
            Unsupported: The system cannot do it.
        """
        if self._handle() is None:
            return
        guard = await start_guard(self.name)
        line, handle = self._open_line(), self._handle()
        if line is None or handle is None:
            guard.dismiss_at_once()
            return
        guard.take(handle, hurried=line.is_hurried)
        self._guard = guard
        self.tell_guard()

    def unguard(self, then: Callable[[], None] = lambda: None) -> None:
        """Dismiss the guard, if there is one; calls `then` when it has let go of the line, or at once."""
        guard, self._guard, self._stops = self._guard, None, None
        if guard is None:
            then()
        else:
            guard.dismiss(then)

    def tell_guard(self) -> None:
        """Tell the guard what stops the device now."""
        if self._guard is not None and self._stops is not None:
            self._guard.tell(*self._stops())

    def _tell_guard_of_change(self) -> None:
        """Tell it that the device listens again, if it was told that it may not."""
        if self._guard is not None and self._guard.awaits_change:
            self.tell_guard()

    def _handle(self) -> int | None:
        """The descriptor of the open line; None where there is none."""
        line = self._open_line()
        return None if line is None else line.descriptor()

    def _open_line(self) -> Line | None:
        """The line; None where it is closed."""
        return None
