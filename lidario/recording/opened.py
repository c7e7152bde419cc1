"""A file that is opened to be read: only a regular one, and only as long as it is whole.

What else has a path may wait for ever when it is opened or read (a FIFO, a terminal) or never end (a device), so it
is refused without being waited for. The size is the one at the first opening: what is added later is not read, and
a file that was made shorter meanwhile is an error, not the end of the file. It is read and never mapped: to read
what is missing behind a map kills the program (SIGBUS).
"""

import os
import re
from pathlib import Path

from lidario.basics.entered import Closing
from lidario.basics.system import cause_of
from lidario.basics.whole_file import kind_of
from lidario.errors import RecordingError


class StoredFile(Closing):
    """A regular file, read in order or from any place; a context manager.

    Args:
        path: The file.
        before: Bytes that it had before, if it was opened before: no more are read.
        folder: Where a relative path begins, if it was opened before.

    Attributes:
        size: Its bytes when it was first opened.
        at: Where it is read next.

    Raises:
        RecordingError: It cannot be opened, is no regular file, or is shorter than it was; the text says which. The
            methods raise it where it cannot be read any more.
    """

    def __init__(self, path: Path, before: int | None = None, folder: Path = Path()) -> None:
        self.path: Path = path
        self.at: int = 0
        place = folder / path
        try:
            kind = kind_of(place.stat().st_mode)
            if not kind:
                # It may have become another one by now, so opening it must not wait either.
                handle = os.open(place, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
                self._file = os.fdopen(handle, "rb")
                kind = kind_of(os.fstat(handle).st_mode)
                self.size: int = os.fstat(handle).st_size
                if kind:
                    self._file.close()
        except OSError as error:
            raise _unreadable(path, error) from error
        if kind:
            raise RecordingError(f"{path} cannot be read: it is {kind}, and a recording is a file")
        if before is not None:
            self.size, is_cut = before, self.size < before
            if is_cut:
                self._file.close()
                raise self._cut()

    def close(self) -> None:
        """Let go of it. Harmless when done before."""
        self._file.close()

    @property
    def left(self) -> int:
        """How many bytes follow."""
        return self.size - self.at

    def seek(self, at: int) -> None:
        """Go on reading there; behind the end nothing is left."""
        self.at = min(at, self.size)
        try:
            self._file.seek(self.at)
        except OSError as error:
            raise _unreadable(self.path, error) from error

    def read(self, size: int) -> bytes:
        """So many bytes, or all that are left where these are fewer."""
        size = min(size, self.left)
        try:
            data = self._file.read(size)
        except OSError as error:
            raise _unreadable(self.path, error) from error
        if len(data) < size:
            raise self._cut()
        self.at += size
        return data

    def _cut(self) -> RecordingError:
        return RecordingError(f"{self.path} cannot be read any further: it was cut while it was read")


def _unreadable(path: Path, error: OSError) -> RecordingError:
    cause = cause_of(error)
    if re.match("(sim|tcp|udp|serial|socket):/|zenoh:", str(path)):
        # A path has one slash where a source has two.
        cause = "it names a lidar, and a recording is a file: `lidario record` makes one"
    return RecordingError(f"{path} cannot be read: {cause}")
