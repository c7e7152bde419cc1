"""Running one coroutine so that a signal ends it as its own cancellation would.

Left alone, SIGTERM and SIGHUP kill a process on the spot, and a lidar would go on turning in an empty room.
Here they, and Ctrl-C, cancel the coroutine instead: the context managers it is in write what stops laser and
motor, and only then does the process end. A second signal cancels the waiting for the device's silence, not
what was written.
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
    """Await ``work()`` in an event loop of its own.

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
        # Where the loop cannot take signals (Windows), asyncio.run cancels on Ctrl-C by itself.
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
    # nohup says that the command shall outlive its terminal.
    if hang_up is not None and signal.getsignal(hang_up) is not signal.SIG_IGN:
        wanted.append(hang_up)
    return wanted
