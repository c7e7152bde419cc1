"""Scans and sectors on their way to their readers: one mailbox each, the latest wins.

A reader that is slower than the device must not make the program hold old scans, nor hold up the port: the
kernel's buffer is 60 ms deep. So a full mailbox drops its oldest scan and counts it, and the count travels with
the next scan the reader gets. Readers do not disturb each other.

`ScanStream` is a class, not an async generator: when a task leaves a generator by ``break``, its cleanup runs
later and elsewhere, and STOP would be late.
"""

from __future__ import annotations

import asyncio
import weakref
from collections import deque
from collections.abc import Callable, Collection, Coroutine
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar, cast

from lidario.basics.arguments import shown, whole, yes_or_no
from lidario.basics.entered import AsyncOnly, Held
from lidario.errors import Busy, InvalidValue, LidarError, LocalProtocolError
from lidario.scans.measured import changed
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
from lidario.session.talking.trouble import twin_of

if TYPE_CHECKING:
    from lidario.session.streaming.scanner import Scanner

T = TypeVar("T")

_HOLD_S = 60.0
"""For how long a timer holds a reader that waits. Then another timer does, if it still waits."""


class _Hold:
    """Keeps a reader alive that waits, where the program itself holds no reference to its task.

    Only a timer of the event loop holds this object. A finalizer reaches the mailbox, and must not reach the frames
    of a task: else, where Ctrl-C ends the loop of a plain program, the session is no garbage, and the device goes
    on. One timer a minute, and not one for each scan: cancelled ones would slow down every other timer.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.waiter: asyncio.Future[None] | None = None  # what the reader waits for
        self._loop = loop
        self._timer = loop.call_later(_HOLD_S, self._stay)

    def _stay(self) -> None:
        if self.waiter is not None:
            self._timer = self._loop.call_later(_HOLD_S, self._stay)

    def end(self) -> None:
        """No reader will wait any more."""
        self._timer.cancel()


class Mailbox(Generic[T]):
    """Holds the latest scans for one reader, or the latest sectors, or what else comes by and by.

    At most `depth` are kept.
    """

    def __init__(self, depth: int, parts: int | None = None) -> None:
        depth = whole(depth, "depth")
        if depth < 1:
            raise InvalidValue(f"a reader keeps at least one {'sector' if parts else 'scan'}, not {shown(depth)}")
        # How many sectors a revolution has for this reader; None where it reads something else.
        self.parts: int | None = parts
        self.dropped: int = 0  # scans dropped since the reader was last told of it
        self.total_dropped: int = 0  # scans dropped altogether
        self._depth = depth
        self._scans: deque[T] = deque()
        self._hold: Callable[[], _Hold | None] = lambda: None  # it is not kept here
        self.ended: bool = False  # whether no more scans will come
        self._error: LidarError | None = None
        # Called when the reader has taken a scan. Where it is set, no scan is dropped: who has set it puts more
        # only when the reader has taken all.
        self.on_taken: Callable[[], None] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether the reader has taken every scan."""
        return not self._scans

    def put(self, scan: T) -> int:
        """Add a scan; returns how many were dropped for it (0 or 1)."""
        if self.ended:
            return 0
        dropped = 0
        if len(self._scans) >= self._depth and self.on_taken is None:
            self._scans.popleft()
            dropped = 1
            self.dropped += 1
            self.total_dropped += 1
        self._scans.append(scan)
        self._wake()
        return dropped

    def end(self, error: LidarError | None = None) -> None:
        """No more scans will come; the reader gets what is left, then `error` or the end of the iteration."""
        if not self.ended:
            self.ended = True
            self._error = error
            self._wake()
            if (hold := self._hold()) is not None:
                hold.end()

    async def get(self) -> T:
        """The oldest scan held, or the next one to come. Cancelling loses nothing.

        Raises:
            StopAsyncIteration: The stream was ended.
            LidarError: The stream ended with this error.
            Busy: Another task is waiting already.
        """
        await self.wait()
        if not self._scans:
            if self._error is not None:
                raise twin_of(self._error)
            raise StopAsyncIteration
        scan = self._scans.popleft()
        if self.on_taken is not None:
            self.on_taken()
        return scan

    async def wait(self) -> None:
        """Return when a scan is held, or no more will come.

        Raises:
            Busy: Another task is waiting already.
        """
        hold = self._hold()
        if hold is not None and hold.waiter is not None:
            raise Busy("two tasks read one stream: give each its own, as each call of lidar.scans() does")
        while not self._scans and not self.ended:
            loop = asyncio.get_running_loop()
            if hold is None:
                hold = _Hold(loop)
                self._hold = weakref.ref(hold)
            hold.waiter = loop.create_future()
            try:
                await hold.waiter
            finally:
                hold.waiter = None

    def _wake(self) -> None:
        hold = self._hold()
        waiter = None if hold is None else hold.waiter
        if waiter is not None and not waiter.done() and not waiter.get_loop().is_closed():
            waiter.set_result(None)


def check_loop(loop: asyncio.AbstractEventLoop, what: str = "the stream was begun") -> None:
    """Raise LocalProtocolError where another event loop runs than this one, or none, as in a forked child."""
    try:
        running = asyncio.get_running_loop()
    except RuntimeError:
        raise LocalProtocolError(
            f"{what} in an event loop, and none runs here: none goes on in a forked child"
        ) from None
    if running is not loop:
        raise LocalProtocolError(f"{what} in another event loop, and what it reads comes only there")


class ReaderStream(AsyncOnly, Held, Generic[T]):
    """What `ScanStream` and `SectorStream` are: one reader, and the mailbox that is handed what it reads."""

    def __init__(
        self,
        source: Scanner,
        mode: str | int | None,
        depth: int,
        force: bool,
        opened: Callable[[], None],
        parts: int | None = None,
        filters: tuple[Callable[[Any], Any], ...] = (),
    ) -> None:
        self._source = source
        self._mode = mode
        self._force = yes_or_no(force, "force")
        self._mailbox: Mailbox[Any] = Mailbox(depth, parts)
        self._filters = filters
        self._left = False
        self._loop: asyncio.AbstractEventLoop | None = None  # in which it has begun
        self._check_open = opened

    @property
    def dropped(self) -> int:
        """Scans, or sectors, that this reader has missed so far."""
        return self._mailbox.total_dropped

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> T:
        if self._left:
            raise StopAsyncIteration
        self._begin()
        try:
            scan = await self._mailbox.get()
            if self._mailbox.dropped:
                scan = changed(scan, dropped_before=self._mailbox.dropped)
                self._mailbox.dropped = 0
            # Here, and not where it is put: what this reader misses costs nothing.
            return cast("T", scan.filtered(*self._filters) if self._filters else scan)
        except BaseException:
            # An error that the program keeps, as in a cancelled task, holds this frame. Without `self` in it, the
            # stream is garbage all the same, and that leaves the device still.
            del self
            raise

    def _begin(self) -> None:
        """Have scans come, unless they do already."""
        if self._loop is None:
            self._check_open()
            self._source.join(self._mailbox, self._mode, self._force)
            self._loop = asyncio.get_running_loop()
            # Run by the garbage collector, perhaps in another thread.
            weakref.finalize(self, _let_go, self._loop, self._source, self._mailbox).atexit = False
        else:
            check_loop(self._loop)

    async def __aenter__(self) -> Self:
        self._check_open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Leave the stream. The last one to be left stops laser and motor. Harmless when done before.

        For a task that waits for the next scan, the iteration ends.

        The stop requests are written before anything is awaited, or, where the device does not listen at that
        moment, by a timer. Cancelling ends only the waiting for that.

        Raises:
            LocalProtocolError: It was called in another event loop, such as one of another thread. The stream goes
                on.
        """
        if self._leave():
            self._source.leave(self._mailbox)
            await self._source.left()

    def release(self) -> None:
        """Leave the stream; the last one to be left stops laser and motor a second later, unless one was begun."""
        if self._leave():
            self._source.leave(self._mailbox, lingers=True)

    def _leave(self) -> bool:
        if self._loop is not None and not self._loop.is_closed():
            # Where none runs, a coroutine is being collected, or this is a forked child.
            with suppress(RuntimeError):
                asyncio.get_running_loop()
                check_loop(self._loop)
        left, self._left = self._left, True
        return self._loop is not None and not left and not self._source.is_forked


class ScanStream(ReaderStream[Scan]):
    """An asynchronous iterator of full revolutions; made by `Lidar.scans`.

    The device begins to scan at the first ``await``. Used as a context manager the stream is left at the end of
    the block, and the last stream to be left stops laser and motor. A stream that nobody holds any more, as after
    ``break`` out of ``async for scan in lidar.scans()``, is left by itself, and the device stops within two
    seconds.

    Iteration ends when `Lidar.stop` is called. It raises `StreamFailed` when the device falls silent, makes no
    revolutions or cannot be started, and `DeviceFault` when it has stopped to protect itself and a reset is of no
    use; the session goes on after both. It raises `DeviceLost` when the port died, and `SessionClosed`
    when the session is closed by another task. A stream that has raised one of these is over, and raises it each
    time: `Lidar.scans` makes another one. With `open_lidar(reconnect=...)` it waits while the device is away.
    Where the program cancels all tasks, the session's own included, a stream that waits for one of these ends with
    `LocalProtocolError`, or with `StreamFailed`.

    Cancelling ``__anext__`` loses no scan, and does not end the stream.
    """

    _instead = "scans come asynchronously: write `async for scan in lidar.scans():`, or `async with` first"


class SectorStream(ReaderStream[Sector]):
    """An asynchronous iterator of parts of revolutions; made by `Lidar.sectors`.

    It begins, ends and fails as a `ScanStream` does, in ``async for`` and ``async with``. The first sectors are
    those of the first revolution that is seen from its beginning.

    Cancelling ``__anext__`` loses no sector, and does not end the stream.
    """

    _instead = "sectors come asynchronously: write `async for sector in lidar.sectors():`"


def until_there(stream: ReaderStream[Any]) -> Coroutine[Any, Any, None]:
    """Begin `stream`, and wait until its next scan is there, or its end; until that is taken a newer one wins."""
    stream._begin()  # noqa: SLF001 - of this module
    return stream._mailbox.wait()  # noqa: SLF001 - of this module


def is_inherited(stream: ReaderStream[Any]) -> bool:
    """Whether this is a forked child: the lidar that `stream` reads is its parent's."""
    return stream._source.is_forked  # noqa: SLF001 - of this module


def next_end(stream: ReaderStream[Any]) -> asyncio.Future[None]:
    """What is done when `stream`, which need not be begun, would end; with the error that it would raise.

    Raises:
        LidarError: The session is over.
    """
    stream._check_open()  # noqa: SLF001 - of this module
    return stream._source.hub.ends  # noqa: SLF001 - of this module


async def until_all(ends: Collection[asyncio.Future[None]]) -> None:
    """Return when all of these ends have come; the first one with an error raises it."""
    done, _ = await asyncio.wait(ends, return_when=asyncio.FIRST_EXCEPTION)
    for each in done:
        if isinstance(error := each.exception(), LidarError):
            raise twin_of(error)


def _let_go(loop: asyncio.AbstractEventLoop, source: Scanner, mailbox: Mailbox[Any]) -> None:
    with suppress(RuntimeError):  # the loop is closed: so is the session, or its own finalizer stops the device
        loop.call_soon_threadsafe(partial(source.leave, mailbox, lingers=True))
