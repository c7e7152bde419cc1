"""An event loop in a thread of its own, with one session in it: what `lidario.sync.lidar` is made of.

Each call hands a coroutine to that loop and waits for its result. What ends the wait early, such as Ctrl-C,
cancels the coroutine. The thread ends with the session: by `LoopThread.end`, when nobody holds the session any
more, or when the interpreter exits. In each case the device is left still before.

Ctrl-C may come at any line of the waiting thread. So the two threads share no lock: requests to the loop go by
`call_soon_threadsafe`, what comes back is waited for by a `Latch`.
"""

import asyncio
import os
import threading
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, Generic, ParamSpec, TypeVar

import anyio

from lidario.basics.system import NO_THREADS, cause_of
from lidario.errors import ConnectFailed, LocalProtocolError, SessionClosed
from lidario.port.at_exit import call_at_exit
from lidario.port.forked import FORKED
from lidario.port.latch import Latch, start_apart
from lidario.session.lidar import Lidar
from lidario.session.opening import OpenLidar

P = ParamSpec("P")
T = TypeVar("T")

_CLOSED = "the session was closed; open_sync() makes a new one"


class LoopThread:
    """An event loop in a thread, and the session that lives there."""

    def __init__(self) -> None:
        self._lidar: Lidar | None = None
        self._pid = os.getpid()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._leave: asyncio.Event | None = None
        self._is_wanted = True
        self._running, self._ended = Latch(), Latch()
        self._error: BaseException | None = None
        self._calls: set[_Call[Any]] = set()
        self._thread = threading.Thread(target=self._main, name="lidario", daemon=True)
        self._unstarted = [self._thread]
        self._forget: Callable[[], None] = lambda: None

    def open(self, opening: OpenLidar) -> Lidar:
        """Start the thread and open the session in it."""

        async def kept() -> Lidar:
            # Noted here and not by the caller, whom Ctrl-C may reach before it has noted anything.
            self._lidar = await opening
            return self._lidar

        self._start()
        self._running.wait()
        return self.call(kept)

    def _start(self) -> None:
        """Start the thread, unless it was started before."""
        start_apart(self._start_once, self._not_started)

    def _start_once(self) -> None:
        with suppress(IndexError):
            self._unstarted.pop().start()

    def _not_started(self, error: Exception) -> None:
        """The system allows no more threads. Who waits for this one is told so; if it begins late, it ends."""
        self._unstarted.clear()
        self._is_wanted = False
        self._error = ConnectFailed(NO_THREADS, reason="missing")
        self._error.__cause__ = error
        self._running.set()
        self._ended.set()

    def _main(self) -> None:
        try:
            # Not asyncio.run: anyio loads its backend now. Loaded where the session closes, after Ctrl-C has ended
            # the program, it makes Python forget Ctrl-C, and the exit code is another one.
            anyio.run(self._run)
        except BaseException as error:
            self._error = error
            if self._loop is None and isinstance(error, OSError):
                self._error = ConnectFailed(f"the system allows no event loop: {cause_of(error)}", reason="missing")
                self._error.__cause__ = error
        finally:
            self._forget()
            self._running.set()
            self._ended.set()
            # Those that the loop had no time to begin.
            for call in self._calls.copy():
                call.give_up()

    async def _run(self) -> None:
        self._leave = asyncio.Event()
        # From here on `end_soon` may set that event.
        self._loop = asyncio.get_running_loop()
        self._running.set()
        if self._is_wanted:
            await self._leave.wait()
        try:
            await self._close()
        finally:
            tasks = [call.task for call in self._calls.copy() if call.task is not None]
            for task in tasks:
                task.cancel()
            if tasks:
                await asyncio.wait(tasks)
            # It may have been opened just now.
            await self._close()

    async def _close(self) -> None:
        if self._lidar is not None:
            await self._lidar.close()

    @property
    def belongs_here(self) -> bool:
        """False in a child of the process that opened the session: a fork copies no threads."""
        return os.getpid() == self._pid

    def call(self, function: Callable[P, Coroutine[Any, Any, T]], *args: P.args, **kwargs: P.kwargs) -> T:
        """Run a coroutine in the loop and return its result; what ends the wait early cancels the coroutine."""
        if not self.belongs_here:
            raise LocalProtocolError(FORKED)
        if threading.get_ident() == self._thread.ident:
            raise LocalProtocolError("a tap is called by the lidar's own thread, which cannot wait for itself")
        call = _Call(lambda: function(*args, **kwargs))
        self._calls.add(call)
        try:
            if self._loop is None:
                raise SessionClosed(_CLOSED)
            try:
                # Behind the line that adds it: the thread finds the call at its end, or the loop is closed by now.
                self._loop.call_soon_threadsafe(call.begin)
            except RuntimeError:
                raise SessionClosed(_CLOSED) from None
            return call.result()
        finally:
            self._calls.discard(call)
            if not call.done.is_set and self._loop is not None:
                with suppress(RuntimeError):
                    self._loop.call_soon_threadsafe(call.cancel)

    def leave(self, function: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """As `call`, of what ends something in the session; a session that was closed has ended all that it had.

        Nothing is done in a forked child: what is to be ended is its parent's.
        """
        if self.belongs_here:
            with suppress(SessionClosed):
                self.call(function)

    def end(self) -> None:
        """Close the session and end the thread. Harmless when done before. Ctrl-C ends only the waiting."""
        if not self.belongs_here:
            return
        if threading.get_ident() == self._thread.ident:
            raise LocalProtocolError("the lidar's own thread cannot wait for its own end")
        self.end_soon()
        if self._unstarted:
            # It was interrupted before it started the thread, and what is waited for is what the thread does last.
            self._start()
        self._ended.wait()
        if self._thread.ident is not None:
            self._thread.join()
        if self._error is not None:
            raise self._error

    def end_at_exit(self) -> None:
        """Have it end when the program does."""
        self._forget = call_at_exit(self.end)

    def end_soon(self) -> None:
        """Have it end, without waiting: the garbage collector may run in any thread, also in this one."""
        if not self.belongs_here:
            return
        self._is_wanted = False
        if self._loop is not None and self._leave is not None:
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._leave.set)


class _Call(Generic[T]):
    """A coroutine that runs in the loop while another thread waits for it."""

    def __init__(self, function: Callable[[], Coroutine[Any, Any, T]]) -> None:
        self._function = function
        self._results: list[T] = []
        self._error: BaseException | None = None
        self.task: asyncio.Task[None] | None = None
        self.done = Latch()

    def begin(self) -> None:
        """Start it; in the loop."""
        self.task = asyncio.get_running_loop().create_task(self._run())

    def cancel(self) -> None:
        """Nobody waits any more; in the loop."""
        if self.task is not None:
            self.task.cancel()

    def give_up(self) -> None:
        """The loop has ended; in its thread."""
        if not self.done.is_set:
            self._error = SessionClosed(_CLOSED)
            self.done.set()

    async def _run(self) -> None:
        try:
            self._results.append(await self._function())
        except asyncio.CancelledError:
            self._error = SessionClosed(_CLOSED)
            raise
        except BaseException as error:
            self._error = error
        finally:
            self.done.set()

    def result(self) -> T:
        """Wait for it; in the other thread."""
        self.done.wait()
        if self._error is not None:
            raise self._error
        return self._results[0]
