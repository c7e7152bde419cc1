"""What a port does for those who watch it.

Its taps see every chunk in either direction: recordings, probing, and programs that ask. Its guard is told what
stops the device, before anything is written, and is dismissed at the end.
"""

import logging
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import TypeAlias

from lidario.port.guard import Guard, start_guard
from lidario.port.line import Line, Tap
from lidario.wire.envelope import Request

_log = logging.getLogger("lidario")

Stops: TypeAlias = Callable[[], tuple[Sequence[Request], Sequence[Request], float]]
"""Gives the requests that leave the device still, those that may do so at the end, and when it listens at the
latest, on the monotonic clock."""


class Guarded:
    """The base of `Port`: its taps and its guard."""

    def __init__(self, name: str) -> None:
        self.name: str = name  # what was opened, for messages
        self.taps: tuple[Tap, ...] = ()  # who sees the chunks, in the order in which they were added
        self._line: Line | None = None
        # Whether this process is a child of the one that opened the port: then the port is the parent's.
        self.is_forked: bool = False
        self._guard: Guard | None = None
        self._stops: Stops | None = None

    def _open_line(self) -> Line | None:
        """The line; None where it is closed, and in a forked child."""
        line = self._line
        return None if line is None or self.is_forked or line.is_closing else line

    def add_tap(self, tap: Tap) -> None:
        """Have `tap` called with every chunk in either direction, after the taps that are there.

        It must be quick. A tap that raises is removed and logged at WARNING.
        """
        # Not what a thread has written before.
        self.show()
        self.taps = (*self.taps, tap)

    def remove_tap(self, tap: Tap) -> None:
        """Stop calling `tap`; ignored where it is not there."""
        taps = list(self.taps)
        if tap in taps:
            taps.remove(tap)
            self.taps = tuple(taps)

    def show(self, *chunks: tuple[str, bytes, int]) -> None:
        """Show chunks to the taps, and what a thread has written meanwhile; in the order of time.

        A tap that raises is removed, and has no other effect; unless it ends the program, as `sys.exit` does. Then
        it must not raise again where the device is stopped.
        """
        repeat = None if self._line is None else self._line.repeat
        written = () if repeat is None else repeat.take_written()
        for chunk in sorted((*chunks, *written), key=itemgetter(2)):
            for tap in self.taps:
                try:
                    tap(*chunk)
                except Exception:
                    self.remove_tap(tap)
                    text = "the tap %r of %s raised an exception and was removed"
                    _log.warning(text, tap, self.name, exc_info=True)
                except BaseException:
                    self.remove_tap(tap)
                    raise

    async def guard(self) -> None:
        """Have another process leave the device still when this one dies (`lidario.port.guard`).

        Ignored where the line has no descriptor that could be passed on: a simulated device in memory ends with its
        program. Cancelling leaves no process behind.

        Raises:
            Unsupported: The system cannot do it.
        """
        line = self._open_line()
        if line is None or line.passed_on() is None:
            return
        guard = await start_guard(self.name)
        passed = None if self._open_line() is None else line.passed_on()
        if passed is None:
            guard.dismiss_at_once()
            return
        handle, hurried = passed
        guard.take(handle, hurried=hurried)
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
