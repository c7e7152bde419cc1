"""An event loop in a thread of its own, with one session in it: what `lidario.blocking` is made of.

Each call hands a coroutine to that loop and waits for its result. What ends the wait early, such as Ctrl-C,
cancels the coroutine. The thread ends with the session: by `LoopThread.end`, when nobody holds the session any
more, or when the interpreter exits. In each case the device is left still before.
"""

from __future__ import annotations

import atexit
import os
import sys
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future, wait
from typing import Any, ParamSpec, TypeVar

import anyio
from anyio.from_thread import BlockingPortal

from lidario.errors import LocalProtocolError, SessionClosed
from lidario.session.lidar import Lidar
from lidario.session.opening import OpenLidar

__all__ = ["LoopThread"]

P = ParamSpec("P")
T = TypeVar("T")

_WAIT_S = 0.2 if sys.platform == "win32" else None
"""On Windows Ctrl-C does not end a wait that has no limit, so the wait is divided."""


class LoopThread:
    """An event loop in a thread, and the session that lives there."""

    def __init__(self) -> None:
        self._lidar: Lidar | None = None
        self._pid = os.getpid()
        self._portal: Future[BlockingPortal] = Future()
        self._thread = threading.Thread(target=anyio.run, args=(self._run,), name="lidario", daemon=True)
        self._ending = threading.Lock()
        self._ended: Future[None] | None = None

    def open(self, opening: OpenLidar) -> Lidar:
        """Start the thread and open the session in it."""

        async def kept() -> Lidar:
            # Noted here and not by the caller, whom Ctrl-C may reach before it has noted anything.
            self._lidar = await opening
            return self._lidar

        self._thread.start()
        wait((self._portal,))
        return self.call(kept)

    async def _run(self) -> None:
        async with BlockingPortal() as portal:
            self._portal.set_result(portal)
            await portal.sleep_until_stopped()

    @property
    def belongs_here(self) -> bool:
        """False in a child of the process that opened the session: a fork copies no threads."""
        return os.getpid() == self._pid

    def call(self, function: Callable[P, Coroutine[Any, Any, T]], *args: P.args, **kwargs: P.kwargs) -> T:
        """Run a coroutine in the loop and return its result; what ends the wait early cancels the coroutine."""
        if not self.belongs_here:
            raise LocalProtocolError("the lidar was opened before a fork: only the parent process can use it")
        try:
            future: Future[T] = self._portal.result().start_task_soon(lambda: function(*args, **kwargs))
        except RuntimeError:
            if self._ended is None:
                raise LocalProtocolError(
                    "a tap is called by the lidar's own thread, which cannot wait for itself"
                ) from None
            raise SessionClosed("the session was closed; open_sync() makes a new one") from None
        try:
            while not wait((future,), _WAIT_S).done:
                pass
            return future.result()
        finally:
            future.cancel()

    def end(self) -> None:
        """Close the session and end the thread. Harmless when done before. Ctrl-C ends only the waiting."""
        ended = self.end_soon()
        while not wait((ended,), _WAIT_S).done:
            pass
        ended.result()

    def end_soon(self) -> Future[None]:
        """Have another thread end it: the garbage collector may run in any, also in the one that is to be ended."""
        with self._ending:
            if self._ended is None:
                self._ended = Future()
                if self.belongs_here:
                    # Not a daemon: the interpreter waits for it, so that the device is left still.
                    threading.Thread(target=self._end, args=(self._ended,), name="lidario-close").start()
                else:
                    self._ended.set_result(None)
            return self._ended

    def end_now(self) -> None:
        """End it in this thread: while the interpreter exits, none can be started."""
        with self._ending:
            if self._ended is not None or not self.belongs_here:
                return
            self._ended = Future()
        self._end(self._ended)

    def _end(self, ended: Future[None]) -> None:
        atexit.unregister(self.end_now)
        try:
            if self._thread.ident is not None:
                portal = self._portal.result()
                if self._lidar is not None:
                    portal.call(self._lidar.close)
                portal.call(portal.stop, True)  # a session that is being opened too
                self._thread.join()
        except BaseException as error:
            ended.set_exception(error)
        else:
            ended.set_result(None)
