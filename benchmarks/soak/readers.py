"""The readers of a soak: tasks that take scans in the background, quickly or slowly."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import lidario
from benchmarks.soak.hour import Hour

_MOST = 3


class Readers:
    """All readers of one session.

    Args:
        hour: Where their scans are counted.
        failed: Called with the error that a reader got.

    Attributes:
        own_tasks: Where their tasks are noted, so that nobody takes them for tasks that were left behind.
    """

    def __init__(self, hour: Hour, failed: Callable[[lidario.LidarError], None]) -> None:
        self.own_tasks: set[asyncio.Task[Any]] = set()
        self._hour = hour
        self._failed = failed
        self._tasks: dict[asyncio.Task[None], None] = {}  # in the order in which they came

    def __len__(self) -> int:
        return len(self._tasks)

    @property
    def is_full(self) -> bool:
        """Whether there are as many as a soak ever has."""
        return len(self._tasks) >= _MOST

    async def begin(self, stream: lidario.ScanStream, *, slow: bool) -> None:
        """Have one more; it has asked for scans when this returns."""
        task = asyncio.get_running_loop().create_task(self._read(stream, slow=slow))
        self._tasks[task] = None
        self.own_tasks.add(task)
        task.add_done_callback(lambda done: self._tasks.pop(done, None))
        task.add_done_callback(self.own_tasks.discard)
        await asyncio.sleep(0)

    async def leave(self, choose: Callable[[list[asyncio.Task[None]]], asyncio.Task[None]]) -> None:
        """One of them leaves, if there is one."""
        if self._tasks:
            reader = choose(list(self._tasks))
            reader.cancel()
            await asyncio.wait([reader])

    async def ended(self) -> None:
        """Return when each has ended by itself."""
        if self._tasks:
            await asyncio.wait(list(self._tasks))

    async def end(self) -> None:
        """All of them leave."""
        for task in self._tasks:
            task.cancel()
        await self.ended()

    async def _read(self, stream: lidario.ScanStream, *, slow: bool) -> None:
        try:
            async with stream:
                async for scan in stream:
                    self._hour.scans += 1
                    if slow and not self._hour.scans % 7:
                        await asyncio.sleep(0.7)
                    assert len(scan.angles) == len(scan.ranges) > 0
        except lidario.LidarError as error:
            self._failed(error)
