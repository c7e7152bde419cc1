"""Recording a session while it runs: a tap that costs next to nothing, and a thread that writes.

The event loop only appends to a queue. The thread wakes four times a second and writes what is there. The queue
is bounded: when the disk is so slow that it fills, or is full, the recording ends in order and the session goes
on. What could not be recorded is counted, and the log says why.

A chunk of the file is complete when a second of the session is in it, and it is handed to the operating system at
once, and to the disk. The thread looks four times a second, so a program that is killed, or a power cut, loses the
last second and a quarter, and what a slow disk takes to write.
"""

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Protocol

from lidario.basics.entered import Entered
from lidario.basics.system import NO_THREADS
from lidario.errors import CannotRecord, LocalProtocolError
from lidario.port.background import start_thread
from lidario.recording.about import About
from lidario.recording.parts import Parts, Split, pattern_of
from lidario.recording.write import FileWriter, cannot_write
from lidario.scans.laserscans import LaserScans
from lidario.scans.scan import Scan

_log = logging.getLogger("lidario")

QUEUE_BYTES = 8 << 20  # most bytes that wait to be written: two minutes of the fastest stream
CHUNK_NS = 1_000_000_000  # time of the session in one chunk of the file
TICK_S = 0.25  # how often the thread writes what is there
CLOSE_TIMEOUT_S = 10.0
"""Longest time that the last writing may take; a disk that hangs must not keep a program from ending."""
POLL_S = 0.005  # how often it is looked whether the thread has opened or closed its file
_ITEM_BYTES = 64  # what an entry of the queue takes beside its bytes, about

_Entry = tuple[int, int, Callable[[FileWriter, int], None]]
"""When (monotonic ns), how many bytes, and what writes it at that wall time."""


class Recorded(Protocol):
    """The session, as far as a recording needs it."""

    @property
    def sends_bytes(self) -> bool:
        """Whether the device sends bytes, which can be recorded; else whole scans."""
        ...

    @property
    def files(self) -> tuple[Path, ...]:
        """Those of the recording that is played; none of a device."""
        ...

    def begin_recording(self, recording: "Recording") -> About:
        """Hand every chunk, event and scan to `recording` from now on; returns what stands at the beginning."""
        ...

    def end_recording(self, recording: "Recording") -> None:
        """Hand it no more; harmless when done before."""
        ...


class Recording(Entered):
    """A recording under way; made by `Lidar.record`, and used as an asynchronous context manager.

    Attributes:
        path: The file; where the recording is split, the one that is written.
        error: Why the recording ended before it was closed, or None. The session goes on without it.
        chunks: Chunks of bytes recorded so far, in both directions.
        scans: Full revolutions that were decoded meanwhile.
    """

    _instead = "a recording is made asynchronously: write `async with lidar.record(path):`"

    def __init__(
        self,
        path: Path,
        session: Recorded,
        *,
        scans: LaserScans | None,
        overwrite: bool,
        sync: bool,
        split: Split = Split(),  # noqa: B008 - it cannot be changed
    ) -> None:
        self.path: Path = path
        self._base = path
        self._split = split
        self.error: CannotRecord | None = None
        self.chunks: int = 0
        self.scans: int = 0
        self._session = session
        self._messages = scans
        self._overwrite = overwrite
        self._sync = sync
        self._entries: deque[_Entry] = deque()
        # Bytes. The loop counts what it has seen, the thread what it has taken, and what of that is in the file.
        self._seen = self._taken = self._written = 0
        self._ending = threading.Event()
        self._open = threading.Event()
        self._thread: threading.Thread | None = None
        self._parts: Parts | None = None

    def __repr__(self) -> str:
        return f"<Recording {self.path}: {self.size} bytes>"

    @property
    def size(self) -> int:
        """Bytes written so far, of all files; it grows once a second."""
        return 0 if self._parts is None else self._parts.size

    @property
    def files(self) -> int:
        """How many files were begun."""
        return 0 if self._parts is None else self._parts.count

    @property
    def source(self) -> str:
        """What ``open_lidar`` and ``decode_file`` take to read all of it: the file, or a pattern of its files."""
        return pattern_of(self._base) if self._split else str(self._base)

    @property
    def lost_bytes(self) -> int:
        """Bytes of the session that are missing in the file, because it could not be written."""
        return 0 if self.error is None else self._seen - self._written

    @property
    def is_running(self) -> bool:
        """Whether what happens is recorded."""
        return self._thread is not None and not self._ending.is_set()

    async def start(self) -> None:
        """Create the file and begin; ``async with`` does so.

        Cancelling it leaves a file without scans, or none. So does Ctrl-C; the session goes on without a recording.

        Raises:
            CannotRecord: The file cannot be written, or exists already, or would hold nothing.
        """
        if self._thread is not None:
            raise LocalProtocolError("a recording can be started once: lidar.record() makes another one")
        if not self._session.sends_bytes and self._messages is None:
            raise CannotRecord(
                "whole scans arrive from there, and a recording keeps bytes, so nothing would be kept. Publish the "
                "lidar with --raw (raw=True), or record with --scans (scans=True): LaserScan for other programs"
            )
        replaces = self._overwrite and not self._split
        if replaces and any(_is_same(each, self.path) for each in self._session.files):
            raise CannotRecord(f"{self.path} is read meanwhile, so it cannot be replaced: name another file")
        try:
            about = self._session.begin_recording(self)
            # A daemon: a disk that hangs must not keep the program from ending.
            try:
                self._thread = start_thread(partial(self._run, about), "lidario: recording")
            except RuntimeError as error:
                raise CannotRecord(f"{self.path} cannot be written: {NO_THREADS}") from error
            await _until(lambda: self._open.is_set() or self.error is not None)
            if self.error is not None:
                raise self.error
        except BaseException:
            self._end()
            raise

    async def close(self) -> None:
        """End the recording, and return when the file is complete. Harmless when done before.

        What came until now is written, for ten seconds at most. Cancelling ends only the waiting.
        """
        thread = self._thread
        self._end()
        if thread is not None:
            await _until(lambda: not thread.is_alive())
            if thread.is_alive():
                self._fail(CannotRecord(f"{self.path}: the disk has not taken the rest for {CLOSE_TIMEOUT_S:g} s"))

    # ---------------------------------------------------------------------------- what the session calls

    def see_chunk(self, direction: str, data: bytes, now: int) -> None:
        """A chunk passed the port at `now`, in nanoseconds; ``"in"`` or ``"out"``."""
        sent = direction == "out"
        if self._add(now, len(data), lambda writer, at_ns: writer.add_chunk(at_ns, sent, data)):
            self.chunks += 1

    def see_event(self, text: str, now: int) -> None:
        """Something was added to the chronicle; `text` is its line."""
        self._add(now, len(text), lambda writer, at_ns: writer.add_event(at_ns, text))

    def see_texts(self, name: str, texts: dict[str, str], now: int) -> None:
        """A named set of texts is to stand in the file, for who knows the name."""
        self._add(now, sum(map(len, texts.values())), lambda writer, _: writer.add_metadata(name, texts))

    def see_scan(self, scan: Scan) -> None:
        """A scan was decoded."""
        if self._ending.is_set():
            return
        self.scans += 1
        messages = self._messages
        if messages is not None:
            self._add(scan.stamp_ns, 12 * len(scan), lambda writer, _: writer.add_scans(messages.take(scan)))

    def _add(self, now: int, size: int, write: Callable[[FileWriter, int], None]) -> bool:
        self._seen += size
        waiting = self._seen - self._taken + _ITEM_BYTES * len(self._entries)
        if waiting > QUEUE_BYTES and not self._ending.is_set():
            self._fail(CannotRecord(f"{self.path}: the disk is too slow for what arrives, so it ends here"))
        if self._ending.is_set():
            return False
        self._entries.append((now, size, write))
        return True

    def _end(self) -> None:
        self._session.end_recording(self)
        self._ending.set()

    def _fail(self, error: CannotRecord) -> None:
        """The recording cannot go on; the first error is kept."""
        if self.error is None:
            self.error = error
            if self._open.is_set():
                _log.warning("the recording ended: %s", error)
        self._ending.set()

    def _run(self, about: About) -> None:
        """The thread."""
        try:
            self._parts = Parts(self._base, about, self._split, overwrite=self._overwrite, sync=self._sync)
            self.path = self._parts.writer.path
            self._open.set()
            self._write(self._parts, about.clock_offset_ns)
            if self._messages is not None:
                self._parts.writer.add_scans(self._messages.rest())
            self._parts.writer.close()
        except CannotRecord as error:
            self._fail(error)
        except (OSError, MemoryError) as error:
            self._fail(cannot_write(self.path, error))
        except Exception as error:
            failure = CannotRecord(f"lidario failed when it wrote {self.path} ({error!r}); please report this")
            failure.__cause__ = error
            self._fail(failure)
        finally:
            if self._parts is not None:
                self._parts.writer.abandon()
            self._entries.clear()

    def _write(self, parts: Parts, clock_offset_ns: int) -> None:
        writer = parts.writer
        first_ns: int | None = None
        flushed = time.monotonic()
        while True:
            # In this order: what was added before the end is written.
            ending = self._ending.wait(TICK_S)
            while self._entries:
                now, size, write = self._entries.popleft()
                if first_ns is not None and now - first_ns >= CHUNK_NS:
                    parts.flush()
                    first_ns, flushed, self._written = None, time.monotonic(), self._taken
                if first_ns is None:
                    writer, first_ns = parts.writer_at(now + clock_offset_ns), now
                    self.path = writer.path
                write(writer, now + clock_offset_ns)
                self._taken += size
            if first_ns is not None and (ending or time.monotonic() - flushed >= CHUNK_NS * 1e-9):
                parts.flush()
                first_ns, flushed, self._written = None, time.monotonic(), self._taken
            if ending:
                return


def _is_same(one: Path, other: Path) -> bool:
    with suppress(OSError):
        return one.samefile(other)
    return False


async def _until(condition: Callable[[], bool]) -> None:
    """Return when `condition` holds, or the time is up. The system's clock decides, not the loop's."""
    deadline = time.monotonic() + CLOSE_TIMEOUT_S
    # Polled, since another thread makes it true, and a loop whose clock is driven waits for no thread.
    while not condition() and time.monotonic() < deadline:  # noqa: ASYNC110
        await asyncio.sleep(POLL_S)
