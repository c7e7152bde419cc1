"""What `lidario.SyncLidar` makes: streams and iterators for ``for``, and recordings for ``with``."""

from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from typing import Generic, Self, TypeVar

from lidario.basics.entered import Closing, Held
from lidario.errors import Busy, LidarError, SessionClosed
from lidario.recording.record import Recording
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
from lidario.session.streaming.line_changes import LineChange, LineChanges
from lidario.session.streaming.stream import ReaderStream
from lidario.sync.loop_thread import LoopThread

T = TypeVar("T")


class SyncReaderStream(Closing, Generic[T]):
    """What `SyncScanStream` and `SyncSectorStream` are: a stream that is read in the session's own thread.

    It holds the session, so that that is not closed while somebody reads.
    """

    def __init__(self, thread: LoopThread, stream: ReaderStream[T], lidar: object) -> None:
        self._thread = thread
        self._stream = stream
        self._lidar = lidar

    @property
    def dropped(self) -> int:
        """Scans, or sectors, that this reader has missed so far."""
        return self._stream.dropped

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> T:
        try:
            taken = self._thread.call(_next, self._stream)
        except Busy:
            # Another thread reads it, and goes on.
            raise
        except BaseException:
            self._release()
            raise
        if taken is None:
            raise StopIteration
        return taken

    def close(self) -> None:
        """Leave the stream. The last one to be left stops laser and motor. Harmless when done before."""
        self._thread.leave(self._stream.aclose)

    def _release(self) -> None:
        with suppress(LidarError):
            self._thread.call(called, self._stream.release)


class SyncScanStream(SyncReaderStream[Scan]):
    """An iterator of full revolutions; made by `SyncLidar.scans`.

    As `ScanStream`, with ``for`` and ``with``: scans come in while the program does something else, and the reader
    gets the latest one. The device begins to scan at the first ``next``. Ctrl-C, or any other exception that is
    raised while it waits, leaves the stream; the last stream to be left stops laser and motor a second later.
    """


class SyncSectorStream(SyncReaderStream[Sector]):
    """An iterator of parts of revolutions; made by `SyncLidar.sectors`.

    As `SectorStream`, with ``for`` and ``with``. It begins, ends and is left as a `SyncScanStream`.
    """


class SyncLineChanges(Held):
    """An iterator of `LineChange`; as `LineChanges`, with ``for``. Ctrl-C ends only the waiting."""

    def __init__(self, thread: LoopThread, changes: LineChanges, lidar: object) -> None:  # noqa: ARG002
        # The session is not held: who only looks at its line does not keep it open.
        self._thread = thread
        self._changes = changes

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> LineChange:
        try:
            change = self._thread.call(_next, self._changes)
        except SessionClosed:
            change = None
        if change is None:
            raise StopIteration
        return change


class SyncRecording(Held):
    """A recording that is made while its ``with`` block runs; made by `SyncLidar.record`.

    Attributes:
        recording: The same as `Lidar.record` makes: its size, its counts, and what ended it early.
    """

    def __init__(self, thread: LoopThread, recording: Recording, lidar: object) -> None:
        self.recording: Recording = recording
        self._thread = thread
        # Held, so that it is not closed meanwhile.
        self._lidar = lidar

    def __enter__(self) -> Recording:
        self._thread.call(self.recording.start)
        return self.recording

    def __exit__(self, *_: object) -> None:
        self._thread.leave(self.recording.close)


async def called(call: Callable[[], T]) -> T:
    """What a call returns that is made in the loop that awaits this."""
    return call()


async def _next(stream: AsyncIterator[T]) -> T | None:
    # StopAsyncIteration cannot pass through a future.
    return await anext(stream, None)
