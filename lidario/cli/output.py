"""Output: data goes to stdout, everything else to stderr.

The reader of our stdout may be slow: ``| less``, Ctrl-S on the terminal, a slow program at the end of a pipe. While
scans run, a write that blocks would block the event loop, and with it the port, whose buffer holds 60 ms, and
the handling of SIGTERM. Therefore a `Worker` writes from its thread, and the caller awaits it. Scans that arrive
meanwhile are dropped whole at the mailbox and counted, and a signal still stops the device.

What is drawn again and again (`watch`, `progress`) is drawn in a thread too, and what is logged is written in one
(`lidario.cli.running`). All of them write to the file descriptor (`lidario.cli.streams`).
"""

from __future__ import annotations

import asyncio
import json
import os
import queue
import sys
import threading
from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from itertools import cycle
from typing import TYPE_CHECKING, Any, Final

import lidario
from lidario.basics.system import NO_THREADS
from lidario.cli.streams import CannotWrite, ReaderGone, beside, can_be_drawn_on, emit, show
from lidario.port.background import start_thread

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table
    from rich.text import Text

PIPE_WIDTH = 160  # columns of a table where there is no terminal; wide enough that no cell is folded
NARROW = 80  # columns below which a table would be folded within its words, to single letters in the end
GRACE_S = 1.0
PROGRESS_GRACE_S = 0.25
"""Shorter: the event loop waits meanwhile, and nothing but the look of the terminal depends on it."""
SPINS_A_SECOND: Final = 12.5


class Worker:
    """A thread that calls what it is handed, one after the other; nothing is told of errors.

    `close` waits for it no longer than `grace_s`: a terminal may take no output.

    Raises:
        ConnectFailed: The system allows no more threads.
    """

    def __init__(self, name: str, grace_s: float = GRACE_S) -> None:
        self._grace_s = grace_s
        self._work: queue.SimpleQueue[Callable[[], object] | None] = queue.SimpleQueue()
        try:
            self._thread = start_thread(self._run, name)
        except RuntimeError as error:
            raise lidario.ConnectFailed(NO_THREADS, reason="missing") from error

    def put(self, work: Callable[[], object]) -> None:
        """Have `work` called after what was handed over before, without waiting."""
        self._work.put(work)

    async def call(self, work: Callable[[], object]) -> None:
        """Have the thread call `work`, and return, or raise, as it does; a write does when the reader has room.

        Cancelling ends the waiting only; `work` may still be called.
        """
        await _done_by(self.put, work)

    def close(self) -> bool:
        """Let the thread finish; False when it cannot in time."""
        self._work.put(None)
        self._thread.join(self._grace_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (work := self._work.get()) is not None:
            with suppress(Exception):
                work()


def emit_beside(text: str) -> Awaitable[None]:
    """As `emit`, in an event loop, and in order with messages; what is returned raises as `emit` does."""
    return _done_by(beside, lambda: emit(text))


def _done_by(put: Callable[[Callable[[], object]], None], work: Callable[[], object]) -> Awaitable[None]:
    """Have a thread call `work`; what is returned waits for that, and raises as it does."""
    done = Future[None]()

    def called() -> None:
        try:
            work()
            done.set_result(None)
        except Exception as error:
            # Any exception: the caller waits until this piece is done. Nobody hears the error where it was
            # cancelled, or its loop is closed.
            done.set_exception(error)

    put(called)
    return asyncio.wrap_future(done)


def dump(value: object) -> None:
    """Write `value` to stdout as JSON, indented; in ASCII, so that no encoding of stdout lacks a character."""
    emit(json.dumps(value, indent=2, allow_nan=False) + "\n")


def in_both_units(hertz: float) -> str:
    """A speed: ``10.00 Hz (600 rpm)``."""
    return f"{hertz:.2f} Hz ({60 * hertz:.0f} rpm)"


def introduced(model: str, serial: str, firmware: str = "") -> str:
    """What a device is, in one line; what it does not tell is left out."""
    told = (("firmware", firmware), ("serial number", serial))
    return ", ".join((model, *(f"{name} {value}" for name, value in told if value)))


def console() -> Console:
    """A rich console on stdout; texts from a device are never interpreted as markup."""
    from rich.console import Console

    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else PIPE_WIDTH
    return Console(width=width, markup=False, highlight=False, emoji=False)


def emit_tables(*parts: RenderableType) -> None:
    """As `emit`, of tables and of texts between them."""
    emit(rendered(console(), *parts))


def rendered(target: Console, *parts: RenderableType) -> str:
    """What `target` would print, as text for `emit`, and with its errors: at the end rich flushes stdout."""
    try:
        with target.capture() as capture:
            for part in parts:
                target.print(part)
    except OSError as error:
        # At the end of a capture, rich flushes stdout.
        raise CannotWrite(error.errno, error.strerror) from error
    return capture.get()


def facts(rows: Iterable[tuple[str, str]], *, gap: int = 2) -> Table:
    """A table of names and values, a line each, and so many columns between them."""
    return _grid(rows, {"style": "bold"}, gap=gap)


def table(titles: Sequence[str], rows: Iterable[Sequence[str]], *, right: Sequence[str] = ()) -> Table:
    """A table with these titles; the columns in `right` are flush right. A list of each row where it is narrow."""
    from rich import box
    from rich.table import Table

    if console().width < NARROW:
        lists = ((*zip(titles, row, strict=True), ("", "")) for row in rows)
        return facts(pair for each in lists for pair in each if pair[1] or not pair[0])
    made = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for title in titles:
        # A source is never folded: it is to be copied.
        made.add_column(
            title, overflow="fold", no_wrap=title == "source", justify="right" if title in right else "left"
        )
    for row in rows:
        made.add_row(*row)
    return made


def judged(rows: Iterable[tuple[str, str, str, str]]) -> Table:
    """A table of verdicts: each with a style, a word of that style, what it is of, and a text.

    Where there is no word, the text has the style.
    """
    from rich.text import Text

    styled = (
        (Text(word, style), what, text) if word else ("", what, Text(text, style))
        for style, word, what, text in rows
    )
    return _grid(styled, {"no_wrap": True}, {"no_wrap": True})


def _grid(rows: Iterable[Sequence[str | Text]], *columns: dict[str, Any], gap: int = 2) -> Table:
    """A table without lines and titles: these columns, and a last one for texts of any length."""
    from rich.table import Table

    made = Table.grid(padding=(0, gap))
    for column in columns:
        made.add_column(**column)
    made.add_column(overflow="fold")
    for row in rows:
        made.add_row(*row)
    return made


@contextmanager
def progress(text: str | Callable[[], str]) -> Iterator[None]:
    """Show on stderr that work goes on; only on a terminal. A `text` that changes is asked for by the thread.

    A thread draws it, and the end waits for that thread no longer than `PROGRESS_GRACE_S`.
    """
    if not can_be_drawn_on(sys.stderr):
        yield
        return
    over = threading.Event()

    def spin() -> None:
        from rich.cells import set_cell_size

        # The terminal may go away meanwhile.
        with suppress(OSError, ReaderGone):
            for mark in cycle("|/-\\"):
                cells = (os.get_terminal_size(sys.stderr.fileno()).columns or NARROW) - 1
                show(set_cell_size(f"{mark} {text() if callable(text) else text}", cells), cells)
                if over.wait(1 / SPINS_A_SECOND):
                    break
            show("", 0)

    worker = Worker("lidario: progress", PROGRESS_GRACE_S)
    worker.put(spin)
    try:
        yield
    finally:
        over.set()
        worker.close()
