"""Running an asyncio program so that the signals which end a service leave its lidars still.

Left alone, SIGTERM (systemd, docker, `kill`) and SIGHUP (a closed terminal) end a process at once: no context
manager is left, no finalizer runs, and laser and motor go on. With `asyncio.run` the first Ctrl-C cancels the main
task, and a second one, as of somebody who presses it twice, raises `KeyboardInterrupt` wherever the program stands,
which may be in the midst of stopping a lidar. `run` makes all of them cancel the main task, as often as they come.
A process that is killed by SIGKILL cannot do anything; its lidar goes on until the next program opens it, unless it
was opened with `guard=True`.
"""

import asyncio
import signal
import threading
import time
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any, TypeVar

from lidario.basics.arguments import shown, yes_or_no
from lidario.errors import InvalidValue, LocalProtocolError
from lidario.loading import load
from lidario.port.forked import let_go_in_children

T = TypeVar("T")
PATIENCE_S = 5.0
"""Leaving a lidar still takes up to 4 s. Later than that, Ctrl-C raises `KeyboardInterrupt` wherever it comes."""
_BY_SIGNAL = 128
"""Shells report a program that a signal has ended by this number plus the signal's."""


def run(main: Coroutine[Any, Any, T], *, debug: bool | None = None) -> T:
    """As `asyncio.run`, but SIGTERM and SIGHUP too cancel `main` and let it end in order.

    A second signal, also a second Ctrl-C, cancels it again: that ends what it waits for while it ends, not the stop
    requests. Ctrl-C more than 5 s after the first one ends a program at once, as one that blocks its event loop.
    Signals are taken only in the main thread, until the last task has ended, and not in forked children. A signal
    that the program ignores (as SIGHUP under ``nohup``) or handles itself stays so.

    Args:
        main: The program.
        debug: As for `asyncio.run`.

    Returns:
        What `main` returns, also when a signal came and `main` ended without letting its cancellation out.

    Raises:
        SystemExit: A signal ended it; the code is 128 plus the number of the signal.
        KeyboardInterrupt: Ctrl-C ended it.
        InvalidValue: `main` is no coroutine, such as a function that was not called; or `debug` is neither true nor
            false.
        LocalProtocolError: An event loop runs in this thread already, as in a notebook.
    """
    given: object = main
    if not isinstance(given, Coroutine):
        raise InvalidValue(f"write `lidario.run(main())`: it takes a coroutine, not {shown(given)}")
    with suppress(RuntimeError):  # none runs
        asyncio.get_running_loop()
        main.close()
        raise LocalProtocolError("an event loop runs here already, as in a notebook: write `await main()`")
    try:
        debug = None if debug is None else yes_or_no(debug, "debug")
    except InvalidValue:
        main.close()
        raise
    signals = _Signals()

    async def guarded() -> T:
        signals.cancel_task()
        return await main

    try:
        # What opens a lidar takes some tenths of a second to load: not while the other tasks of `main` wait.
        load("lidario.session.opening")
        with asyncio.Runner(debug=debug) as runner:
            return runner.run(guarded())
    except asyncio.CancelledError:
        if signals.caught and signals.caught[0] == signal.SIGINT:
            raise KeyboardInterrupt from None
        if signals.caught:
            raise SystemExit(_BY_SIGNAL + signals.caught[0]) from None
        raise
    finally:
        signals.give_up()
        # Its cleanup can go no further where something has ended the loop a second time: that is raised.
        with suppress(RuntimeError):
            main.close()


class _Signals:
    """What signals do while `run` runs: they cancel the main task."""

    def __init__(self) -> None:
        self.caught: list[int] = []  # those that came
        # SIGTERM and SIGHUP, unless the program has chosen what they do. Windows knows no SIGHUP.
        known = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
        self._ending: list[int] = [each for each in known if signal.getsignal(each) is signal.SIG_DFL]
        self._before = {number: signal.getsignal(number) for number in (signal.SIGINT, *self._ending)}
        self._taken: dict[int, Any] = {}
        self._interrupted_at = 0.0

    def cancel_task(self) -> None:
        """From now on they cancel the current task.

        The loop gives them back when it is closed, and not before: a lidar may be held by another task than `main`,
        and the runner cancels that one after `main` has ended.
        """
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None

        def cancel(number: int) -> None:
            self.caught.append(number)
            task.cancel()

        def interrupt(number: int, _: object) -> None:
            self._interrupted_at = self._interrupted_at or time.monotonic()
            if time.monotonic() > self._interrupted_at + PATIENCE_S or loop.is_closed():
                raise KeyboardInterrupt
            loop.call_soon_threadsafe(cancel, number)

        if threading.current_thread() is threading.main_thread():
            for number in self._ending:
                with suppress(NotImplementedError):  # loops on Windows take none
                    loop.add_signal_handler(number, cancel, number)
            if self._before[signal.SIGINT] is signal.default_int_handler:
                # In place of the runner's handler, which would be given back before the other tasks have ended.
                signal.signal(signal.SIGINT, interrupt)
            now = {number: signal.getsignal(number) for number in self._before}
            self._taken = {number: now[number] for number in now if now[number] is not self._before[number]}
            let_go_in_children(self)

    def forked(self) -> None:
        """In a forked child they do what they did before. Else one sent to it would wake the loop of its parent."""
        taken = self.give_up()
        if taken:
            signal.set_wakeup_fd(-1)
        for number, handler in taken.items():
            # Unless the program has meanwhile chosen what they do.
            if signal.getsignal(number) is handler:
                signal.signal(number, self._before[number])

    def give_up(self) -> dict[int, Any]:
        """When the loop is closed they are the program's again, also in children. Returns what was taken."""
        taken, self._taken = self._taken, {}
        if signal.SIGINT in taken and signal.getsignal(signal.SIGINT) is taken[signal.SIGINT]:
            # The loop gives back the others.
            signal.signal(signal.SIGINT, self._before[signal.SIGINT])
        return taken
