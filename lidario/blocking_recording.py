"""Recordings without ``await``."""

from __future__ import annotations

from contextlib import suppress
from types import TracebackType

from lidario.errors import SessionClosed
from lidario.recording.record import Recording
from lidario.session.loop_thread import LoopThread

__all__ = ["SyncRecording"]


class SyncRecording:
    """A recording that is made while its ``with`` block runs; made by `SyncLidar.record`.

    Attributes:
        recording: The same as `Lidar.record` makes: its size, its counts, and what ended it early.
    """

    def __init__(self, thread: LoopThread, recording: Recording) -> None:
        self.recording: Recording = recording
        self._thread = thread

    def __enter__(self) -> Recording:
        self._thread.call(self.recording.start)
        return self.recording

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # A session that was closed in the block has ended its recordings.
        with suppress(SessionClosed):
            self._thread.call(self.recording.close)
