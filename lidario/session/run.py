"""Running an asyncio program so that the signals which end a service leave its lidars still.

Left alone, SIGTERM (systemd, docker, `kill`) and SIGHUP (a closed terminal) end a process at once: no context
manager is left, no finalizer runs, and laser and motor go on. `run` makes them cancel the main task, as
`asyncio.run` does on Ctrl-C. A process that is killed by SIGKILL cannot do anything; its lidar goes on until the
next program opens it.
"""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

__all__ = ["run"]

T = TypeVar("T")
_BY_SIGNAL = 128
"""Shells report a program that a signal has ended by this number plus the signal's."""


def run(main: Coroutine[Any, Any, T], *, debug: bool | None = None) -> T:
    """As `asyncio.run`, but SIGTERM and SIGHUP too cancel `main` and let it end in order.

    A second signal cancels it again: that ends what it waits for while it ends, not the stop requests. Signals are
    taken only in the main thread. SIGHUP stays ignored where it is, as under ``nohup``.

    Args:
        main: The program.
        debug: As for `asyncio.run`.

    Returns:
        What `main` returns, also when a signal came and `main` ended without letting its cancellation out.

    Raises:
        SystemExit: A signal ended it; the code is 128 plus the number of the signal.
        KeyboardInterrupt: Ctrl-C ended it.
    """
    caught: list[int] = []

    async def guarded() -> T:
        with _signals_cancel(caught):
            return await main

    try:
        with asyncio.Runner(debug=debug) as runner:
            return runner.run(guarded())
    except asyncio.CancelledError:
        if caught:
            raise SystemExit(_BY_SIGNAL + caught[0]) from None
        raise
    finally:
        main.close()


@contextmanager
def _signals_cancel(caught: list[int]) -> Iterator[None]:
    """While it lasts, signals cancel the current task, and their numbers are kept in `caught`."""
    loop, task = asyncio.get_running_loop(), asyncio.current_task()
    assert task is not None

    def cancel(number: int) -> None:
        caught.append(number)
        task.cancel()

    taken: list[int] = []
    if threading.current_thread() is threading.main_thread():
        for number in _ending_signals():
            with suppress(NotImplementedError):  # loops on Windows take none; asyncio.run handles Ctrl-C there
                loop.add_signal_handler(number, cancel, number)
                taken.append(number)
    try:
        yield
    finally:
        for number in taken:
            loop.remove_signal_handler(number)


def _ending_signals() -> list[int]:
    """SIGTERM, and SIGHUP where there is one and it is not ignored. SIGINT is left to `asyncio.Runner`."""
    wanted: list[int] = [signal.SIGTERM]
    hang_up = getattr(signal, "SIGHUP", None)
    if hang_up is not None and signal.getsignal(hang_up) is not signal.SIG_IGN:
        wanted.append(hang_up)
    return wanted
