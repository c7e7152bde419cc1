"""Sectors without ``await``: the stream that `lidario.SyncLidar.sectors` makes.

It is a `SyncScanStream` whose mailbox is handed sectors, with the types of sectors.
"""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING, Self, cast

from lidario.sector import Sector

if TYPE_CHECKING:
    from lidario.blocking import SyncScanStream

__all__ = ["SyncSectorStream"]


class SyncSectorStream:
    """An iterator of parts of revolutions; made by `SyncLidar.sectors`.

    As `SectorStream`, with ``for`` and ``with``. It begins, ends and is left as a `SyncScanStream`.
    """

    def __init__(self, stream: SyncScanStream) -> None:
        self._stream = stream

    @property
    def dropped(self) -> int:
        """Sectors this reader has missed so far."""
        return self._stream.dropped

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Sector:
        return cast("Sector", next(self._stream))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the stream. The last one to be left stops laser and motor. Harmless when done before."""
        self._stream.close()
