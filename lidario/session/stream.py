"""Scans on their way to their readers: one mailbox each, the latest wins.

A reader that is slower than the device must not make the program hold old scans, nor hold up the port: the
kernel's buffer is 60 ms deep. So a full mailbox drops its oldest scan and counts it, and the count travels with
the next scan the reader gets. Readers do not disturb each other.

`ScanStream` is a class, not an async generator: when a task leaves a generator by ``break``, its cleanup runs
later and elsewhere, and STOP would be late.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import Protocol, Self
from weakref import WeakSet

from lidario.errors import Busy, DeviceLost, LidarError, SessionClosed
from lidario.model import Scan

__all__ = ["Hub", "Mailbox", "ScanSource", "ScanStream"]


class Mailbox:
    """Holds the latest scans for one reader.

    Attributes:
        dropped: Scans dropped since the reader last took one.
        total_dropped: Scans dropped altogether.
    """

    def __init__(self, depth: int) -> None:
        if depth < 1:
            raise ValueError(f"a mailbox holds at least one scan, not {depth}")
        self.dropped = 0
        self.total_dropped = 0
        self._depth = depth
        self._scans: deque[Scan] = deque()
        self._waiter: asyncio.Future[None] | None = None
        self._ended = False
        self._error: LidarError | None = None

    def put(self, scan: Scan) -> int:
        """Add a scan; returns how many were dropped for it (0 or 1)."""
        if self._ended:
            return 0
        dropped = 0
        if len(self._scans) == self._depth:
            self._scans.popleft()
            dropped = 1
            self.dropped += 1
            self.total_dropped += 1
        self._scans.append(scan)
        self._wake()
        return dropped

    def end(self, error: LidarError | None = None) -> None:
        """No more scans will come; the reader gets what is left, then `error` or the end of the iteration."""
        if not self._ended:
            self._ended = True
            self._error = error
            self._wake()

    async def get(self) -> Scan:
        """The oldest scan held, or the next one to come. Cancelling loses nothing.

        Raises:
            StopAsyncIteration: The stream was ended.
            LidarError: The stream ended with this error.
            Busy: Another task is waiting already.
        """
        if self._waiter is not None:
            raise Busy("two tasks read one stream: give each its own, as lidar.scans() makes them")
        while not self._scans:
            if self._error is not None:
                raise self._error
            if self._ended:
                raise StopAsyncIteration
            self._waiter = asyncio.get_running_loop().create_future()
            try:
                await self._waiter
            finally:
                self._waiter = None
        scan = self._scans.popleft()
        if self.dropped:
            scan = replace(scan, dropped_before=self.dropped)
            self.dropped = 0
        return scan

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


class Hub:
    """Hands every scan to every mailbox. A mailbox that nobody holds any more is forgotten."""

    def __init__(self) -> None:
        self._mailboxes: WeakSet[Mailbox] = WeakSet()
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._mailboxes)

    def add(self, mailbox: Mailbox) -> None:
        """Begin to hand scans to `mailbox`."""
        self._mailboxes.add(mailbox)

    def discard(self, mailbox: Mailbox) -> None:
        """Hand it none any more."""
        self._mailboxes.discard(mailbox)

    def publish(self, scan: Scan) -> None:
        """Hand `scan` to everybody."""
        for mailbox in tuple(self._mailboxes):
            self.dropped += mailbox.put(scan)

    def end(self, error: DeviceLost | SessionClosed | None = None) -> None:
        """End every stream; each gets an error of its own, so that tracebacks do not mix."""
        for mailbox in tuple(self._mailboxes):
            own = None
            if error is not None:
                own = type(error)(str(error))
                own.__cause__ = error
            mailbox.end(own)
        self._mailboxes.clear()


class ScanSource(Protocol):
    """What a `ScanStream` needs of the session."""

    async def join(self, mailbox: Mailbox, mode: str | int | None, force: bool) -> None:
        """Start scanning in that mode unless it runs already, and hand scans to `mailbox`."""
        ...

    def leave(self, mailbox: Mailbox) -> None:
        """Hand `mailbox` no more; the last one to leave stops the device."""
        ...

    async def left(self) -> None:
        """Return when what `leave` wrote has reached the device."""
        ...


class ScanStream:
    """An asynchronous iterator of full revolutions; made by `Lidar.scans`.

    The device begins to scan at the first ``await``. Used as a context manager the stream is left at the end of
    the block, and the last stream to be left stops laser and motor; otherwise they run until the session is
    closed. Iteration ends when `Lidar.stop` is called, and raises `DeviceLost` when the device is gone or falls
    silent, `SessionClosed` when the session is closed by another task.

    Cancelling ``__anext__`` loses no scan.
    """

    def __init__(
        self, source: ScanSource, mode: str | int | None, depth: int, force: bool, opened: Callable[[], None]
    ) -> None:
        self._source = source
        self._mode = mode
        self._force = force
        self._mailbox = Mailbox(depth)
        self._joined = False
        self._left = False
        self._check_open = opened

    @property
    def dropped(self) -> int:
        """Scans this reader has missed so far."""
        return self._mailbox.total_dropped

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Scan:
        if self._left:
            raise StopAsyncIteration
        if not self._joined:
            self._check_open()
            await self._source.join(self._mailbox, self._mode, self._force)
            self._joined = True
        return await self._mailbox.get()

    async def __aenter__(self) -> Self:
        self._check_open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Leave the stream; STOP is written before anything is awaited. Harmless when done before."""
        if not self._left:
            self._left = True
            self._source.leave(self._mailbox)
            await self._source.left()
