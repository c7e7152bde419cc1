"""Several open lidars read as one: `merged`, and the stream it returns."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import AsyncExitStack
from typing import Self

from lidario.arguments import shown
from lidario.entered import AsyncOnly
from lidario.errors import Busy, InvalidValue
from lidario.merging import OLDEST_S, Merged, MergedScans
from lidario.points import Motion, Mount
from lidario.scan import Scan
from lidario.session.lidar import Lidar
from lidario.session.streaming.stream import ScanStream, begin, check_loop, until_there


class MergedStream(AsyncOnly):
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
        # Those that have not ended, by the number of their lidar.
        self._streams: dict[int, ScanStream] = {}
        self._entered = AsyncExitStack()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._is_read = False
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
        if self._is_read:
            raise Busy("two tasks read one stream: give each its own, as lidario.merged() does")
        self._is_read = True
        try:
            await self._begin()
            while self._streams and not self._is_over:
                scans = await self._next()
                found = None
                for number, scan in scans.items():
                    found = self._scans.take(number, scan, more=number != next(reversed(scans)))
                if found is not None:
                    return found
            raise StopAsyncIteration
        except asyncio.CancelledError:
            # No scan was taken, and nothing is lost.
            raise
        except BaseException:
            await self.close()
            raise
        finally:
            self._is_read = False

    async def _next(self) -> dict[int, Scan]:
        """Wait until scans are there, and take them. A lidar whose stream has ended is read no more."""
        scans: dict[int, Scan] = {}
        for number in await until_there(self._streams):
            try:
                scans[number] = await anext(self._streams[number])  # it is there: nothing comes between
            except StopAsyncIteration:
                del self._streams[number]
        return scans

    async def close(self) -> None:
        """End the streams. Laser and motor of each lidar stop, unless another task reads it.

        Harmless when done before.

        Raises:
            LocalProtocolError: It was called in another event loop, such as one of another thread. The streams go
                on.
        """
        if self._loop is not None and not self._loop.is_closed():
            check_loop(self._loop)
        self._is_over = True
        await self._entered.aclose()

    async def _begin(self) -> None:
        if self._loop is not None or self._is_over:
            return
        for number, lidar in enumerate(self._lidars):
            self._streams[number] = await self._entered.enter_async_context(lidar.scans(self._mode))
        for stream in self._streams.values():
            begin(stream)
        self._loop = asyncio.get_running_loop()


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
            f"there are {len(lidars)} lidars, and mounts are a list with one for each, not {shown(mounts)}"
        )
    return MergedStream(lidars, MergedScans(mounts, motion, oldest_s), mode)
