"""Several open lidars read as one: `merged`, and the stream it returns."""

import asyncio
from collections.abc import Sequence
from contextlib import AsyncExitStack
from typing import Self

from lidario.basics.arguments import shown
from lidario.basics.entered import AsyncOnly, Held
from lidario.basics.words import counted
from lidario.errors import Busy, InvalidValue
from lidario.scans.merging import OLDEST_S, Merged, MergedScans
from lidario.scans.points import Motion, Mount
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar
from lidario.session.streaming.stream import ScanStream, check_loop, is_inherited, until_there


class MergedStream(AsyncOnly, Held):
    """What `merged` returns: an asynchronous iterator of `Merged`, best used in ``async with``.

    Its streams begin with the first ``anext`` or with the block, and end with the block, with `close`, or with an
    error; after a ``break``, with the last reference to it. Where another task stops one of the lidars, or the
    recording that it is comes to its end, the others go on, and `Merged.missing` tells of it; the iteration ends
    with the last of them. An error of one lidar ends all. Two tasks cannot read one stream.
    """

    _instead = "several lidars are read asynchronously: write `async for cloud in lidario.merged(front, rear):`"

    def __init__(self, lidars: Sequence[Lidar], scans: MergedScans, mode: str | int | None) -> None:
        self._lidars = tuple(lidars)
        self._scans = scans
        self._mode = mode
        self._streams: list[ScanStream] = []
        self._entered = AsyncExitStack()
        self._reading: dict[int, asyncio.Task[None]] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._read = asyncio.Lock()
        self._is_over = False

    async def __aenter__(self) -> Self:
        await self._begin()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Merged:
        if self._loop is not None:
            check_loop(self._loop)
        try:
            if self._read.locked():
                raise Busy("two tasks read one stream: give each its own, as lidario.merged() does")
            async with self._read:
                if self._is_over:
                    raise StopAsyncIteration
                await self._begin()
                while True:
                    await asyncio.wait(self._reading.values(), return_when=asyncio.FIRST_COMPLETED)
                    if self._is_over:
                        # Another task has closed it.
                        raise StopAsyncIteration
                    for number, each in self._reading.items():
                        if each.cancelled():
                            # The program has cancelled all tasks, and goes on. No scan was taken.
                            self._reading[number] = self._next(number)
                    scans = await self._ready()
                    found = None
                    for number, scan in scans.items():
                        found = self._scans.take(number, scan, more=number != next(reversed(scans)))
                    if found is not None:
                        return found
                    if not self._reading:
                        raise StopAsyncIteration
        except (asyncio.CancelledError, Busy):
            # What is being read goes on, and nothing is lost. An error that the program keeps, as in a cancelled
            # task, holds this frame; without `self` in it, the stream is garbage all the same.
            del self
            raise
        except BaseException:
            await self.close()
            raise

    async def _ready(self) -> dict[int, Scan]:
        """The scans that are there. A lidar whose stream has ended is read no more."""
        scans: dict[int, Scan] = {}
        for number in [number for number, each in self._reading.items() if each.done()]:
            try:
                scans[number] = await anext(self._streams[number])  # it is there: nothing comes between
                self._reading[number] = self._next(number)
            except StopAsyncIteration:
                del self._reading[number]
        return scans

    async def close(self) -> None:
        """End the streams. Laser and motor of each lidar stop, unless another task reads it.

        Harmless when done before. In a forked child nothing is done: the lidars are its parent's.

        Raises:
            LocalProtocolError: It was called in another event loop, such as one of another thread. The streams go
                on.
        """
        if self._loop is not None and self._loop.is_closed():
            # The tasks that read have gone with it.
            self._reading.clear()
        elif any(map(is_inherited, self._streams)):
            return
        elif self._loop is not None:
            check_loop(self._loop)
        self._is_over = True
        reading = tuple(self._reading.values())
        self._reading.clear()
        for each in reading:
            each.cancel()
        try:
            # Not one by one: a cancellation of theirs would look like one of the task that waits here.
            if reading:
                await asyncio.wait(reading)
        finally:
            self._streams = []
            await self._entered.aclose()

    async def _begin(self) -> None:
        if self._reading or self._is_over:
            return
        for lidar in self._lidars:
            self._streams.append(await self._entered.enter_async_context(lidar.scans(self._mode)))
        self._reading.update((number, self._next(number)) for number in range(len(self._streams)))
        self._loop = asyncio.get_running_loop()

    def _next(self, number: int) -> asyncio.Task[None]:
        # It takes no scan: while the program is busy, the latest one wins. An error is raised where one is taken.
        # It does not hold the stream: where a reader leaves by `break`, the streams go with this one.
        return asyncio.create_task(until_there(self._streams[number]), name=f"lidario: read lidar {number}")


def merged(
    *lidars: Lidar,
    mounts: Sequence[Mount] | None = None,
    motion: Motion | None = None,
    mode: str | int | None = None,
    oldest_s: float = OLDEST_S,
) -> MergedStream:
    """Read several lidars as one, for ``async for``: each turn one cloud in the robot's frame.

    ::

        async for cloud in lidario.merged(front, rear):
            print(len(cloud.points), cloud.missing)

    Args:
        lidars: Open lidars of this event loop, of any families.
        mounts: Where each is on the robot; None for those of the file of settings (`Lidar.config`).
        motion: How the robot moves, as for `Scan.points`; None for not at all.
        mode: As for `Lidar.scans`.
        oldest_s: Seconds after its end from which a scan is too old to be in a cloud.

    Raises:
        InvalidValue: There is no lidar, one is none, there are not as many mounts, or a lidar has no mount.
    """
    for each in lidars:
        if not isinstance(each, Lidar):
            raise InvalidValue(f"merged() takes open lidars, not {shown(each)}")
    if mounts is None:
        for each in lidars:
            if each.config.mount is None:
                raise InvalidValue(
                    f"the settings do not say where {each.info.model} {each.info.serial} is mounted: "
                    "give mounts= (--mount of the command), or a file of settings that says it"
                )
        mounts = [each.config.mount or Mount() for each in lidars]
    if not isinstance(mounts, Sequence) or len(mounts) != len(lidars):
        raise InvalidValue(
            f"mounts of {counted(len(lidars), 'lidar')} are a list with one for each, not {shown(mounts)}"
        )
    return MergedStream(lidars, MergedScans(mounts, motion, oldest_s), mode)
