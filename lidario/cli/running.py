"""Runs one coroutine; a signal ends it by cancelling it.

By default SIGTERM and SIGHUP end a process at once, and laser and motor would stay on. Here these signals and
Ctrl-C cancel the coroutine instead: its context managers write the stop requests for laser and motor, and then the
process ends. A second signal cancels only the waiting until the device is silent; the stop requests are written
already.
"""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TypeVar

from lidario.cli.errors import Stopped

__all__ = ["run"]

T = TypeVar("T")


def run(work: Callable[[], Awaitable[T]]) -> T:
    """Await ``work()`` in a new event loop.

    Raises:
        Stopped: SIGINT, SIGTERM or SIGHUP ended it.
    """
    caught: list[int] = []

    async def watched() -> T:
        with _signals_cancel(caught):
            return await work()

    try:
        return asyncio.run(watched())
    except KeyboardInterrupt:
        # Where the loop cannot take signals (Windows), asyncio.run itself cancels on Ctrl-C.
        raise Stopped(signal.SIGINT) from None
    except (asyncio.CancelledError, Exception) as error:
        if caught:
            raise Stopped(caught[0]) from error
        raise


@contextmanager
def _signals_cancel(caught: list[int]) -> Iterator[None]:
    loop, task = asyncio.get_running_loop(), asyncio.current_task()
    assert task is not None

    def stop(number: int) -> None:
        caught.append(number)
        task.cancel()

    added = []
    if threading.current_thread() is threading.main_thread():
        for number in _signals():
            with suppress(NotImplementedError):
                loop.add_signal_handler(number, stop, number)
                added.append(number)
    try:
        yield
    finally:
        for number in added:
            loop.remove_signal_handler(number)


def _signals() -> list[int]:
    wanted: list[int] = [signal.SIGINT, signal.SIGTERM]
    hang_up = getattr(signal, "SIGHUP", None)
    # Under nohup the command continues after its terminal is closed.
    if hang_up is not None and signal.getsignal(hang_up) is not signal.SIG_IGN:
        wanted.append(hang_up)
    return wanted
