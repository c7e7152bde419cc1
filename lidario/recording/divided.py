"""One long recording, decoded by several processes, each of which takes a span of its time.

The number of a scan, its time stamp and what is counted as missing depend on what came before. So each process but
the first one begins half a minute before its span, and tells what its decoder holds at each place of the half
minute behind that. The one before it goes on until it holds the same at the same place: from there on both find the
same scans, and it stops. Where the two never come to hold the same, it does not stop. So the scans are those of one
process, whatever happens, and at worst it takes as long.
"""

from __future__ import annotations

import os
import pickle
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory
from typing import IO, Any, Final, Generic, NamedTuple, TypeVar

from lidario.errors import CannotRecord
from lidario.filters.base import Filter
from lidario.recording.decode_file import FileDecoder
from lidario.recording.read import McapRecording
from lidario.scan import Scan

T = TypeVar("T")

LEAD_NS: Final = 30_000_000_000
"""From where decoding begins to where a span does, and from there to where it is given up: a device's clock is
followed over twenty seconds."""
LEAST_NS: Final = 4 * LEAD_NS
"""Of a span; in a shorter one, nothing would be gained."""
_POLL_S: Final = 0.01
_LENGTH: Final = Struct("<q")


class _Mark(NamedTuple):
    """Of a decoder at one place: what it held, how many bytes it had written, and the number of the next scan."""

    held: bytes
    written: int
    seq: int


class Joined(NamedTuple):
    """Which span is gone on with, from which byte of its file on, and what is added to its numbers."""

    span: int
    begin: int
    shift: int


class _Division(NamedTuple, Generic[T]):
    """What all processes know; `seams` has where each span begins."""

    recording: McapRecording
    filters: tuple[Filter, ...]
    make: Callable[[Iterable[Scan]], Iterable[T]]
    folder: Path
    seams: tuple[int, ...]


@contextmanager
def divided(
    decoder: FileDecoder,
    jobs: int,
    make: Callable[[Iterable[Scan]], Iterable[T]],
    folder: Path,
    renumbered: Callable[[T, int], T] = lambda each, _: each,
) -> Iterator[Iterable[T]]:
    """What is made of all scans of a recording, in order.

    Args:
        decoder: What decodes it.
        jobs: Processes, this one included.
        make: Makes it, of each scan for itself. It runs on those processes.
        folder: Where files of them may stand meanwhile.
        renumbered: The same of a scan whose number is so much larger.
    """
    recording = decoder.recording
    spans = min(jobs, recording.duration_ns // LEAST_NS)
    if spans < 2 or not isinstance(recording, McapRecording):
        yield make(decoder)
        return
    # This process reads the file once before, and writes what all have made: its span is half as long.
    parts = (0, *range(1, 2 * spans - 1, 2))
    seams = tuple(recording.began_ns + part * recording.duration_ns // (2 * spans - 1) for part in parts)
    with ExitStack() as open_:
        part = Path(open_.enter_context(TemporaryDirectory(dir=folder, prefix=".export-")))
        pool = open_.enter_context(processes(spans - 1, part))
        # It goes before the processes are waited for: then they stop.
        open_.callback(shutil.rmtree, part, ignore_errors=True)
        division = _Division(recording, decoder.filters, make, part, seams)
        # The last one first: each needs to know of those behind it.
        others = {number: pool.submit(_spool, division, number) for number in reversed(range(1, spans))}
        yield _in_order(division, others, renumbered)


@contextmanager
def processes(count: int, folder: Path | None = None) -> Iterator[Executor]:
    """So many processes, which end when this one is killed; what they wrote to `folder` then goes with them.

    Where the block raises, as by Ctrl-C, they end in the midst of what they do.
    """
    # Not forked: a process that has threads, or a terminal in use, must not be copied.
    context = get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    with theirs, ours, ProcessPoolExecutor(count, context, _end_with_parent, (theirs, folder)) as pool:
        try:
            yield pool
        except BaseException:
            ours.close()
            raise


def _end_with_parent(lifeline: Connection, folder: Path | None) -> None:
    def wait() -> None:
        # The other end is closed, by the parent or with it.
        with suppress(EOFError, OSError):
            lifeline.recv_bytes()
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _in_order(
    division: _Division[T], others: dict[int, Future[Joined | None]], renumbered: Callable[[T, int], T]
) -> Iterator[T]:
    span, shift = _Span(division, 0, others), 0
    yield from span.made()
    joined = span.joined
    while joined is not None:
        shift += joined.shift
        with open(division.folder / str(joined.span), "rb") as file:
            file.seek(joined.begin)
            for each in _spooled(file, others, joined.span):
                yield renumbered(pickle.loads(each), shift)
        joined = others[joined.span].result()


def _spooled(file: IO[bytes], others: dict[int, Future[Joined | None]], number: int) -> Iterator[bytes]:
    """What another process has written and writes, to its end; raises what any of them raises."""
    while True:
        begin, has_ended = file.tell(), others[number].done()
        data = file.read(_LENGTH.size)
        size = _LENGTH.unpack(data)[0] if len(data) == _LENGTH.size else -1
        if size >= 0 and len(data := file.read(size)) == size:
            yield data
            continue
        _check(others)
        if has_ended:
            return
        file.seek(begin)
        time.sleep(_POLL_S)


def _check(others: dict[int, Future[Joined | None]]) -> None:
    """Raise what a process that has ended raises."""
    for other in others.values():
        try:
            if other.done():
                other.result()
        except BrokenExecutor:
            raise CannotRecord("a process that decodes a part of it was killed: is memory short?") from None


def _spool(division: _Division[Any], number: int) -> Joined | None:
    """Write what is made of a span to a file; returns what is gone on with behind it. Runs in any process."""
    with open(division.folder / str(number), "wb") as file:
        span = _Span(division, number, {}, file.tell)
        for each in span.made():
            data = pickle.dumps(each, pickle.HIGHEST_PROTOCOL)
            file.write(_LENGTH.pack(len(data)) + data)
        span.tell()
    return span.joined


class _Span(Generic[T]):
    """Decodes a span, and those behind it as far as nobody else can."""

    def __init__(
        self,
        division: _Division[T],
        number: int,
        others: dict[int, Future[Joined | None]],
        written: Callable[[], int] = int,
    ) -> None:
        self.joined: Joined | None = None
        self._division, self._number, self._others, self._written = division, number, others, written
        self._decoder = FileDecoder(division.recording.path, recording=division.recording)
        self._decoder.filters = division.filters
        self._marks: dict[int, _Mark] | None = {} if number else None
        self._next = number + 1

    def made(self) -> Iterator[T]:
        """What is made of its scans."""
        begin_ns = self._division.seams[self._number] - LEAD_NS if self._number else None
        yield from self._division.make(self._decoder.part(begin_ns, self._watch))

    def tell(self) -> None:
        """Tell where another one may go on with it. Harmless when done before."""
        if self._marks is not None:
            path = self._path_of(self._number)
            path.with_suffix(".part").write_bytes(pickle.dumps(self._marks))
            os.replace(path.with_suffix(".part"), path)
            self._marks = None

    def _watch(self, place: int, at_ns: int, hold: Callable[[], bytes]) -> bool:
        seams = self._division.seams
        if not self._division.folder.exists():
            return True
        if self._marks is not None and at_ns >= seams[self._number]:
            if at_ns < seams[self._number] + LEAD_NS:
                self._marks[place] = _Mark(hold(), self._written(), self._seq)
            else:
                self.tell()
        while self._next < len(seams) and at_ns >= seams[self._next] + LEAD_NS:
            self._next += 1
        if self._next == len(seams) or at_ns < seams[self._next]:
            return False
        mark = self._marks_of(self._next).get(place)
        if mark is None or mark.held != hold():
            return False
        self.joined = Joined(self._next, mark.written, self._seq - mark.seq)
        return True

    @property
    def _seq(self) -> int:
        return self._decoder.stats.scans + self._decoder.stats.missed_scans

    def _path_of(self, number: int) -> Path:
        return self._division.folder / f"{number}.marks"

    def _marks_of(self, number: int) -> dict[int, _Mark]:
        """What another process tells; it began at the same time, so it is waited for."""
        while not (path := self._path_of(number)).exists():
            if not self._division.folder.exists():
                return {}
            _check(self._others)
            time.sleep(_POLL_S)
        marks: dict[int, _Mark] = pickle.loads(path.read_bytes())
        return marks
