"""The Record button: a file for each wish, whenever it comes."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from lidario import Lidar
from lidario.web.keeper import Keeper
from tests.support.loop import driven


class Recorded:
    """A lidar without a serial number, of which the file is made and closed when the test says so."""

    def __init__(self) -> None:
        self.info = SimpleNamespace(model="LD06", serial="")
        self.paths: list[Path] = []
        self.closing = asyncio.Event()
        self.may_close = asyncio.Event()

    @asynccontextmanager
    async def record(self, path: Path) -> AsyncIterator[SimpleNamespace]:
        self.paths.append(path)
        await asyncio.sleep(0.1)
        self._make(path)
        yield SimpleNamespace(error=None, scans=3)
        self.closing.set()
        await self.may_close.wait()

    def _make(self, path: Path) -> None:
        path.touch(exist_ok=False)

    def serve(self, keeper: Keeper) -> asyncio.Task[None]:
        return asyncio.create_task(keeper.serve(cast("Lidar", self)))


@driven
async def test_each_recording_of_the_same_second_has_a_file_of_its_own(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("time.strftime", lambda _: "20261231-235959")
        lidars, keepers = [Recorded(), Recorded()], [Keeper(tmp_path, lambda: None) for _ in range(2)]
        serving = [lidar.serve(keeper) for lidar, keeper in zip(lidars, keepers, strict=True)]
        for lidar in lidars:
            lidar.may_close.set()
        for wish in (True, False, True):
            for keeper in keepers:
                keeper.ask(on=wish)
            await asyncio.sleep(3)
        assert [keeper.error for keeper in keepers] == ["", ""]
        assert sorted(os.listdir(tmp_path)) == [
            *(f"ld06-20261231-235959-{number}.mcap" for number in (2, 3, 4)),
            "ld06-20261231-235959.mcap",
        ]
        assert [keeper.name for keeper in keepers] == [lidar.paths[-1].name for lidar in lidars]
        for task in serving:
            task.cancel()
        await asyncio.wait(serving)


@driven
async def test_a_wish_that_comes_while_the_file_is_closed_is_not_forgotten(tmp_path: Path) -> None:
    told: list[bool] = []
    lidar, keeper = Recorded(), Keeper(tmp_path, lambda: told.append(keeper.is_whole))
    serving = lidar.serve(keeper)
    keeper.ask(on=True)
    await asyncio.sleep(3)
    keeper.ask(on=False)
    await lidar.closing.wait()
    # The page tells of the file when it can be read.
    assert (keeper.is_on, keeper.is_whole, len(lidar.paths)) == (False, False, 1)
    keeper.ask(on=True)
    lidar.may_close.set()
    await asyncio.sleep(3)
    assert (keeper.is_on, len(lidar.paths), told) == (True, 2, [False, True, False])
    serving.cancel()
    await asyncio.wait([serving])
