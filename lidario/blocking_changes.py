"""What becomes of the line, without ``await``: the iterator that `lidario.SyncLidar.line_changes` makes."""

from __future__ import annotations

from typing import Self

from lidario.errors import SessionClosed
from lidario.session.line_changes import LineChange, LineChanges
from lidario.session.loop_thread import LoopThread

__all__ = ["SyncLineChanges"]


class SyncLineChanges:
    """An iterator of `LineChange`; as `LineChanges`, with ``for``. Ctrl-C ends only the waiting."""

    def __init__(self, thread: LoopThread, changes: LineChanges) -> None:
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


async def _next(changes: LineChanges) -> LineChange | None:
    # StopAsyncIteration cannot pass through a future.
    try:
        return await anext(changes)
    except StopAsyncIteration:
        return None
