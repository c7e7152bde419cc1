"""Recordings without ``await``."""

from __future__ import annotations

import os
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING

from lidario.errors import SessionClosed
from lidario.laserscans import LaserScans
from lidario.recording.record import Recording
from lidario.session.loop_thread import LoopThread

if TYPE_CHECKING:
    from lidario.session.lidar import Lidar

__all__ = ["SyncRecorder", "SyncRecording"]


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


class SyncRecorder:
    """What of `SyncLidar` makes recordings."""

    _lidar: Lidar
    _thread: LoopThread

    def record(
        self,
        path: str | os.PathLike[str],
        *,
        scans: bool | LaserScans = False,
        overwrite: bool = False,
        sync: bool = True,
        split_s: float | None = None,
        split_bytes: int | None = None,
        keep_bytes: int | None = None,
    ) -> SyncRecording:
        """As `Lidar.record`, for use in ``with``."""

        async def made() -> Recording:
            return self._lidar.record(
                path,
                scans=scans,
                overwrite=overwrite,
                sync=sync,
                split_s=split_s,
                split_bytes=split_bytes,
                keep_bytes=keep_bytes,
            )

        return SyncRecording(self._thread, self._thread.call(made))
