"""The files of one recording: a single one, or parts that are named by time, of which the oldest may go.

Each part begins with what the device had said by then, with the stream that runs and with the place of its first
byte. So it is a recording by itself, and lacks only what its first and its last revolution have in its neighbours.
Read together (`lidario.recording.read`) the parts hold the same bytes as one file would, none twice.
"""

import contextlib
import glob
import logging
import re
import stat
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from lidario.basics.arguments import finite, shown, whole
from lidario.basics.system import cause_of
from lidario.errors import CannotRecord, InvalidValue
from lidario.recording.about import About
from lidario.recording.write import FileWriter, is_written

_log = logging.getLogger("lidario")

LEAST_S = 1.0
LEAST_BYTES = 100_000
"""A part holds a second at least, so that the times in two names differ."""
MOST_S = 1e9
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Split:
    """When a recording goes on in another file, and how much of it is kept.

    Attributes:
        seconds: Time in a file; None for any.
        size: Bytes of a file, about: the second in which they are reached is in it. None for any.
        keep: Bytes of all files together; the oldest go. None to keep all.
        names: What who gives these three calls them, for errors.

    Raises:
        InvalidValue: A figure that cannot be.
    """

    seconds: float | None = None
    size: int | None = None
    keep: int | None = None
    names: tuple[str, str, str] = ("split_s", "split_bytes", "keep_bytes")

    def __post_init__(self) -> None:
        seconds, size, keep = self.names
        if self.seconds is not None and not LEAST_S <= finite(self.seconds, seconds) <= MOST_S:
            raise InvalidValue(f"{seconds} is {LEAST_S:g} to {MOST_S:.0f} seconds, not {shown(self.seconds)}")
        if self.size is not None and whole(self.size, size) < LEAST_BYTES:
            raise InvalidValue(f"{size} is {LEAST_BYTES} bytes or more, not {shown(self.size)}")
        if self.keep is None:
            return
        least = 2 * (self.size or LEAST_BYTES)
        if whole(self.keep, keep) < least:
            raise InvalidValue(f"{keep} is {least} bytes or more, two files, not {shown(self.keep)}")
        if not self:
            either = " or ".join(dict.fromkeys((seconds, size)))
            raise InvalidValue(f"{keep} removes whole files: {either} says when the next one begins")

    def __bool__(self) -> bool:
        return self.seconds is not None or self.size is not None

    def is_due(self, seconds: float, size: int) -> bool:
        """Whether a file that holds so much is to be the last one no more."""
        if seconds < LEAST_S:
            return False
        by_time = self.seconds is not None and seconds >= self.seconds
        return by_time or (self.size is not None and size >= self.size)


class Parts:
    """Writes a recording to its file or files. All of it raises CannotRecord where that cannot be.

    Where it is split, `path` is what the names of the parts are made of, as ``run-20260131T235959Z.mcap``; they are
    always new. `overwrite` is for one that is not. There were `count` files, and `writer` writes the last one.
    """

    def __init__(self, path: Path, about: About, split: Split, *, overwrite: bool, sync: bool) -> None:
        self.count: int = 1
        # A program may go to another folder meanwhile, as a daemon does: all files belong into the same one.
        self._base = path.absolute() if split else path
        self._split = split
        self._sync = sync
        self._closed_size = 0
        # Of the first chunk in the file: a lidar that takes its time to begin leaves no empty file.
        self._began_ns: int | None = None
        # The files of this name that are complete, also those of another program that ran before. Those of one that
        # runs must not go.
        self._complete = _sizes_of(self._base) if split.keep is not None else {}
        self.writer: FileWriter = (
            self._begin(about.began_ns, about) if split else FileWriter(path, about, overwrite=overwrite, sync=sync)
        )

    @property
    def size(self) -> int:
        """Bytes written so far, also those that are not kept any more."""
        return self._closed_size + self.writer.size

    def writer_at(self, at_ns: int) -> FileWriter:
        """The file to which goes what comes from that time of the file's clock on; no chunk is begun in it."""
        if self._began_ns is None:
            self._began_ns = at_ns
        elif self._split.is_due((at_ns - self._began_ns) / _NS, self.writer.size):
            former = self.writer
            try:
                # First, so that one of the two is always seen to be written.
                self.writer = self._begin(at_ns, former.about_now(at_ns))
            finally:
                former.close()
            self._closed_size += former.size
            self._complete[former.path] = former.size
            self._began_ns = at_ns
            self.count += 1
        return self.writer

    def _begin(self, at_ns: int, about: About) -> FileWriter:
        """A new file with the name of that time, or seconds later: a clock that was set back may have used it.

        So may another recorder, at this very moment.
        """
        while True:
            try:
                return FileWriter(_named(self._base, at_ns), about, sync=self._sync)
            except CannotRecord as error:
                if not isinstance(error.__cause__, FileExistsError):
                    raise
                at_ns += _NS

    def flush(self) -> None:
        """End the chunk and hand it to the operating system; let files go where there are too many."""
        self.writer.flush()
        keep = self._split.keep
        while keep is not None and self._complete and sum(self._complete.values()) + self.writer.size > keep:
            oldest = min(self._complete)
            del self._complete[oldest]
            try:
                oldest.unlink(missing_ok=True)
            except OSError as error:
                _log.warning("%s is too old to keep, and cannot be removed: %s", oldest, cause_of(error))


def pattern_of(path: Path) -> str:
    """What names all the parts of a recording, as a source."""
    return f"{glob.escape(str(path.with_suffix('')))}-*{glob.escape(path.suffix)}"


def _named(path: Path, at_ns: int) -> Path:
    # Of UTC: local time goes back once a year.
    at = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=at_ns // _NS)
    return path.with_name(f"{path.stem}-{at:%Y%m%dT%H%M%SZ}{path.suffix}")


def _sizes_of(path: Path) -> dict[Path, int]:
    """The parts that are there, and their sizes. Raises CannotRecord where another recorder writes one of them."""
    name = re.compile(rf"{re.escape(path.stem)}-\d{{8}}T\d{{6}}Z{re.escape(path.suffix)}", re.ASCII)
    found: dict[Path, int] = {}
    for part in map(Path, glob.glob(pattern_of(path))):
        # Another program may remove it just now.
        with contextlib.suppress(OSError):
            if name.fullmatch(part.name) and stat.S_ISREG(part.lstat().st_mode):
                if is_written(part):
                    raise CannotRecord(
                        f"{part} is written by another recorder, whose files would be removed with the oldest of "
                        "this name: give each recorder a name of its own"
                    )
                found[part] = part.stat().st_size
    return found
