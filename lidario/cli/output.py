"""Output: data goes to stdout, everything else to stderr.

The reader of our stdout may be slow: ``| less``, Ctrl-S on the terminal, a slow program at the end of a pipe. While
scans run, a write that blocks would block the event loop, and with it the port, whose buffer holds 60 ms, and
the handling of SIGTERM. Therefore `Writer` writes from a thread, and the caller awaits it. Scans that arrive
meanwhile are dropped whole at the mailbox and counted, and a signal still stops the device.

A reader that has closed the pipe is not an error: it becomes `ReaderGone`, which ends the command silently.
"""

from __future__ import annotations

import asyncio
import json
import os
import queue
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import click

from lidario.cli.errors import ReaderGone

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

__all__ = ["Writer", "console", "dump", "emit", "introduced", "message", "progress", "rendered"]

PIPE_WIDTH = 160
"""Columns of a table where there is no terminal; wide enough that no cell is folded."""
GRACE_S = 1.0


class Writer:
    """Writes to stdout from a thread, one piece at a time."""

    def __init__(self) -> None:
        self._pieces: queue.SimpleQueue[tuple[str, asyncio.Future[None]] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="lidario: stdout", daemon=True)
        self._thread.start()

    async def write(self, text: str) -> None:
        """Write `text`, and return when the reader has taken it or there is room for it.

        Cancelling ends the waiting only; the text may still be written.

        Raises:
            ReaderGone: The reader has closed stdout.
            OSError: It cannot be written.
        """
        done = asyncio.get_running_loop().create_future()
        self._pieces.put((text, done))
        await done

    def put(self, text: str) -> None:
        """Have `text` written after what was handed over before, without waiting; errors are not told."""
        done = asyncio.get_running_loop().create_future()
        done.add_done_callback(lambda future: future.exception())
        self._pieces.put((text, done))

    def close(self) -> bool:
        """Let the thread finish; False when it cannot, because the reader does not read."""
        self._pieces.put(None)
        self._thread.join(GRACE_S)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (piece := self._pieces.get()) is not None:
            text, done = piece
            error: Exception | None = None
            try:
                emit(text)
            except Exception as caught:
                # Any exception: the caller waits until this piece is done.
                error = caught
            # The loop is closed when the command was ended while this write was blocked.
            with suppress(RuntimeError):
                done.get_loop().call_soon_threadsafe(_settle, done, error)


def emit(text: str) -> None:
    """Write data to stdout, at once.

    Raises:
        ReaderGone: The reader has closed stdout.
        OSError: It cannot be written.
    """
    try:
        handle = _handle()
        if handle is None:
            click.echo(text, nl=False)
            return
        data = text.encode(sys.stdout.encoding, "replace")
        while data:
            data = data[os.write(handle, data) :]
    except BrokenPipeError as error:
        raise ReaderGone from error


def _handle() -> int | None:
    """The file descriptor of stdout, if there is one that takes bytes.

    Writing to it avoids Python's buffer: nothing remains there when the process ends, and a thread that is blocked
    in a write holds no lock.
    """
    if os.name != "posix":
        return None
    try:
        return sys.stdout.fileno()
    except (OSError, ValueError):
        return None


def dump(value: object) -> None:
    """Write `value` to stdout as JSON, indented."""
    emit(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def message(text: str) -> None:
    """Write a line to stderr; where it cannot be written, as on a full disk, the work goes on without it."""
    with suppress(OSError):
        click.echo(text, err=True)


def introduced(model: str, serial: str, firmware: str = "") -> str:
    """What a device is, in one line; what it does not tell is left out."""
    told = (("firmware", firmware), ("serial number", serial))
    return ", ".join((model, *(f"{name} {value}" for name, value in told if value)))


def console(*, stderr: bool = False) -> Console:
    """A rich console on stdout or stderr; texts from a device are never interpreted as markup."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() or "COLUMNS" in os.environ else PIPE_WIDTH
    return Console(stderr=stderr, width=width, markup=False, highlight=False, emoji=False)


def rendered(target: Console, *parts: RenderableType) -> str:
    """What `target` would print, as text for `emit`."""
    with target.capture() as capture:
        for part in parts:
            target.print(part)
    return capture.get()


@contextmanager
def progress(text: str) -> Iterator[None]:
    """Show on stderr that work goes on; only on a terminal."""
    if not sys.stderr.isatty():
        yield
        return
    with console(stderr=True).status(text):
        yield


def _settle(done: asyncio.Future[None], error: Exception | None) -> None:
    if done.done():
        return
    if error is None:
        done.set_result(None)
    else:
        done.set_exception(error)
