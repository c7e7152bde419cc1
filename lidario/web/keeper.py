"""Records a lidar that is shown, from when a viewer asks for it until one asks for its end.

Each recording is a file of its own in one folder, named by the time at which it began. So nothing is replaced, and
a viewer names no path.
"""

import asyncio
import os
import re
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from lidario import Lidar, LidarError

_LOOK_S: Final = 1.0
"""How soon an end that the disk has brought is told."""
_written: Final[set[Path]] = set()
"""A thread makes the file: a name may be taken before it is there."""


class Keeper:
    """The recordings of one lidar in a folder; `tell` is called when one has begun or ended.

    The file that is written, or was the last one, has so many full revolutions (`scans`); it can be read when it
    `is_whole`. Why it ended unasked, or could not begin, is the `error`.
    """

    def __init__(self, folder: Path, tell: Callable[[], object]) -> None:
        self.name: str = ""
        self.error: str = ""
        self.scans: int = 0
        self.is_whole: bool = False
        self._folder = folder
        self._tell = tell
        self._asked = asyncio.Event()
        self._over = asyncio.Event()

    @property
    def is_on(self) -> bool:
        """Whether it records, or will as soon as the lidar is open."""
        return self._asked.is_set()

    def ask(self, *, on: bool) -> None:
        """Begin a recording, or end the one that is written; harmless where it is so already."""
        if on:
            self._over.clear()
            self._asked.set()
        else:
            self._asked.clear()
            self._over.set()

    async def serve(self, lidar: Lidar) -> None:
        """Record this lidar whenever it is asked for, until cancelled; a recording is whole then."""
        while True:
            await self._asked.wait()
            try:
                await self._record(lidar)
            except LidarError as error:
                self.error = str(error)
                self.ask(on=False)
            self._tell()

    async def _record(self, lidar: Lidar) -> None:
        self.error, self.scans, self.is_whole = "", 0, False
        path = _free(self._folder / _name(lidar))
        self.name = path.name
        _written.add(path)
        try:
            async with lidar.record(path) as recording:
                self._tell()
                try:
                    while recording.error is None and self.is_on:
                        with suppress(TimeoutError):
                            async with asyncio.timeout(_LOOK_S):
                                await self._over.wait()
                        self.scans = recording.scans
                finally:
                    self.scans = recording.scans
                # Before the file is closed: a wish that comes meanwhile is for the next one.
                self.ask(on=False)
            self.is_whole = True
            if recording.error is not None:
                self.error = str(recording.error)
        finally:
            _written.discard(path)


def _name(lidar: Lidar) -> str:
    """By model, serial number and time: two lidars may be recorded in the same second."""
    about = re.sub(r"[^a-z0-9]+", "-", f"{lidar.info.model} {lidar.info.serial[:6]}".casefold()).strip("-")
    return f"{about or 'lidar'}-{time.strftime('%Y%m%d-%H%M%S')}.mcap"


def _free(path: Path) -> Path:
    """This name, or one with a number behind it: a lidar that tells no serial number is called like others."""
    free, number = path, 1
    while free in _written or os.path.lexists(free):
        number += 1
        free = path.with_stem(f"{path.stem}-{number}")
    return free
