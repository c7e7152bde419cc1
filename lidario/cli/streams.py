"""Text to stdout and stderr, written to their file descriptors at once.

Python's own streams keep what they could not write, on a full disk say. At the end of the process they try again,
and when that fails too, the exit code is 120, whatever the verb has earned. A thread that is blocked in such a
stream also holds its lock, and then neither a message nor the end of the interpreter gets past it.

Only the standard library is imported here: `lidario --version` needs nothing else.
"""

import codecs
import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final, TextIO, cast

_AS_GIVEN: Final = "lidario-as-given"
_INSTEAD: Final = {"\u2026": "...", "\u2192": "->", "\u00b0": "deg", "\u00b5": "u"}
"""For what the verbs write beside ASCII."""


TAKEN_S: Final = 1.0  # how soon somebody must take what is written behind `hurry`
_ROOM: Final = 4096  # bytes that a pipe takes without waiting, where it takes any


class _Now:
    """How text is written at the moment."""

    # Has a thread call what writes a message; None where no thread does that.
    beside: Callable[[Callable[[], object]], None] | None = None
    patience_s: float | None = None  # how long a write waits for a reader; None for as long as it takes
    shown = 0  # cells of the terminal's last line that `show` has written


class CannotWrite(OSError):
    """Stdout takes no output: the disk is full, say."""

    def __str__(self) -> str:
        return f"stdout cannot be written: {self.strerror}. Free some room, or send the output elsewhere"


class ReaderGone(Exception):
    """The reader of our stdout has closed it, as ``head`` does. This is not an error."""


def emit(text: str) -> None:
    """Write data to stdout.

    Raises:
        ReaderGone: The reader has closed stdout.
        CannotWrite: It cannot be written.
    """
    try:
        write(sys.stdout, text)
    except OSError as error:
        raise CannotWrite(error.errno, error.strerror) from error


def message(text: str) -> None:
    """Write a line to stderr; where it cannot be written, as on a full disk, the work goes on without it."""

    def written() -> None:
        with suppress(OSError, ReaderGone):
            write(sys.stderr, f"{_erased()}{text}\n")

    beside(written)


def can_be_drawn_on(stream: TextIO) -> bool:
    """Whether it is a terminal on which a line can be written again."""
    return stream.isatty() and os.environ.get("TERM", "").lower() not in ("dumb", "unknown")


def show(text: str, cells: int) -> None:
    """Write a line of so many cells to stderr, a terminal, in place of the one before; messages take its place.

    Raises as `write`.
    """
    drawn = f"\r{text}" if cells else _erased()
    # Noted before and behind: a message of another thread may erase a line that is not there yet, but it never
    # leaves one that is.
    _Now.shown = cells
    write(sys.stderr, drawn)
    _Now.shown = cells


def _erased() -> str:
    """What takes the line of `show` off the terminal; without codes, which not every terminal knows."""
    cells, _Now.shown = _Now.shown, 0
    return f"\r{' ' * cells}\r" if cells else ""


def beside(work: Callable[[], object]) -> None:
    """Have `work`, which writes, called in order by the thread of `messages_by`; at once where there is none."""
    if _Now.beside is None:
        work()
    else:
        _Now.beside(work)


@contextmanager
def messages_by(put: Callable[[Callable[[], object]], None]) -> Iterator[None]:
    """Hand what writes a message to `put` in the block; with that nothing that writes one waits."""
    _Now.beside = put
    try:
        yield
    finally:
        _Now.beside = None


def hurry(wanted: bool) -> None:
    """Whether the command was told to end: then text that nobody takes within `TAKEN_S` is left out."""
    _Now.patience_s = TAKEN_S if wanted else None


def write(stream: TextIO, text: str) -> None:
    """Write text to a stream, past Python's buffer where it has a file descriptor.

    Raises:
        ReaderGone: The reader has closed it.
        OSError: It cannot be written.
    """
    try:
        handle = _handle(stream)
        data = text.encode(stream.encoding, _AS_GIVEN)
        if handle is None:
            # A pipe on Windows has the code page of the system, in which many characters are missing.
            stream.write(data.decode(stream.encoding, "replace"))
            stream.flush()
            return
        while data:
            data = data[os.write(handle, data if _may_wait(handle) else data[:_ROOM]) :]
    except BrokenPipeError as error:
        raise ReaderGone from error


def finish() -> None:
    """Let nothing remain in the streams that Python would fail on at its end.

    What others have written there (a library that prints, a warning) is lost where it cannot be written.
    """
    for name in ("stdout", "stderr"):
        try:
            getattr(sys, name).flush()
        except (OSError, ValueError):
            setattr(sys, name, nowhere("w"))


def nowhere(mode: str) -> TextIO:
    """A standard stream, ``r`` or ``w``, that leads nowhere; it stays open until the process ends."""
    handle = os.open(os.devnull, os.O_RDONLY if mode == "r" else os.O_WRONLY)
    # It is never closed. With ``closefd=False``, Python does not warn of that at the end of the process.
    return cast("TextIO", open(handle, mode, encoding="utf-8", closefd=False))


def _as_given(error: UnicodeError) -> tuple[bytes, int]:
    """What is written for characters that an encoding lacks.

    The name of a file may hold bytes that are no characters (``os.fsdecode``). They are written as those bytes, so
    that a script finds the file by the name that it reads. An arrow, a degree sign and the like are written in
    ASCII; everything else becomes a question mark.
    """
    assert isinstance(error, UnicodeEncodeError)
    lacking = error.object[error.start : error.end]
    written = (
        bytes([ord(c) & 0xFF]) if "\udc80" <= c <= "\udcff" else _INSTEAD.get(c, "?").encode() for c in lacking
    )
    return b"".join(written), error.end


codecs.register_error(_AS_GIVEN, _as_given)


def _may_wait(handle: int) -> bool:
    """Whether a write may take as long as it likes; if not, raises `ReaderGone` where nobody takes anything."""
    if _Now.patience_s is None:
        return True
    poll = select.poll()
    poll.register(handle, select.POLLOUT)
    if not poll.poll(_Now.patience_s * 1000):
        _Now.patience_s = 0.0
        raise ReaderGone
    return False


def _handle(stream: TextIO) -> int | None:
    """The file descriptor of `stream`, if there is one that takes bytes."""
    if os.name != "posix":
        return None
    try:
        return stream.fileno()
    except (OSError, ValueError):
        return None
