"""What becomes of the line to a device, for programs that show it: lost, back, over.

A session that comes back by itself ends nothing when its line is lost: readers only wait. Who wants to show that
reads the changes, which `lidario.session.streaming.failures` and `lidario.session.streaming.scanner` tell here.
"""

import asyncio
import weakref
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, Literal, Self, TypeAlias

from lidario.basics.entered import Held
from lidario.session.streaming.stream import Mailbox, check_loop

LineState: TypeAlias = Literal["connected", "away", "back", "ended"]

_MOST: Final = 64
"""Changes that wait for a slow reader; the oldest ones are dropped."""


@dataclass(frozen=True, slots=True)
class LineChange:
    """One change of the line to a device.

    Attributes:
        state: ``connected`` at the beginning; ``away`` when the line is lost, and the session comes back; ``back``
            when it is; ``ended`` when an error has ended the session.
        reason: What happened to the line, in a sentence; empty where it is there.
        stamp_ns: When that was, monotonic nanoseconds.
    """

    state: LineState
    reason: str
    stamp_ns: int


class LineChanges(Held):
    """An asynchronous iterator of `LineChange`; made by `Lidar.line_changes`. One task may read it at a time.

    It begins with how the line is now. It ends when the session is closed, or behind ``ended``. It keeps no session
    open, and needs no end of its own.
    """

    def __init__(self, first: LineChange | None, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._mailbox: Mailbox[LineChange] = Mailbox(_MOST)
        self.put(first)

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> LineChange:
        """The next change. Cancelling loses none.

        Raises:
            Busy: Another task is waiting already.
            LocalProtocolError: It was called in another event loop than that of the session.
        """
        check_loop(self._loop, "the lidar was opened")
        return await self._mailbox.get()

    def put(self, change: LineChange | None) -> None:
        """Add a change; None for the end."""
        if change is None:
            self._mailbox.end()
        else:
            self._mailbox.put(change)


class LineWatch:
    """Tells everybody who reads the changes of one session."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._readers: weakref.WeakSet[LineChanges] = weakref.WeakSet()
        self._now: LineChange | None = self._change("connected", "")

    def read(self) -> LineChanges:
        """A new reader, which begins with how it is now; nothing comes where the session is over."""
        now = self._now
        first = now if now is None or now.state == "away" else self._change("connected", "")
        changes = LineChanges(first, self._loop)
        self._readers.add(changes)
        return changes

    def tell(self, state: LineState, reason: str = "") -> None:
        """The line has changed."""
        if self._now is not None and self._now.state != "ended":
            self._now = self._change(state, reason)
            self._hand_out(self._now)

    def end(self) -> None:
        """The session is over. In any thread: a session that is garbage is let go of wherever that is found."""
        if self._now is not None:
            self._now = None
            with suppress(RuntimeError):  # the loop is closed, so no reader waits
                self._loop.call_soon_threadsafe(self._hand_out, None)

    def _change(self, state: LineState, reason: str) -> LineChange:
        return LineChange(state, reason, round(self._loop.time() * 1e9))

    def _hand_out(self, change: LineChange | None) -> None:
        for reader in list(self._readers):
            reader.put(change)
