"""Of a recording in parts so much is kept: which files go, where other programs are at work in the folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path

import pytest

import lidario
from lidario.errors import CannotRecord
from lidario.recording.export import must_be_writable
from tests.support.children import BOUND, FORKS, child
from tests.support.loop import driven
from tests.support.recorded import record


@driven
async def test_the_files_of_another_recorder_do_not_go(tmp_path: Path) -> None:
    """Each would have removed what the other one had just recorded."""
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        path = tmp_path / "run.mcap"
        async with lidar.record(path, split_s=60.0) as other:
            with pytest.raises(CannotRecord, match=f"{other.path} is written by another recorder"):
                await lidar.record(path, split_s=60.0, keep_bytes=10**6).start()
        async with lidar.record(path, split_s=60.0, keep_bytes=10**6):
            pass
    assert len(os.listdir(tmp_path)) == 2


@driven
async def test_a_file_that_is_written_is_not_replaced(tmp_path: Path) -> None:
    """What had been recorded by then was gone, and the other recording ended."""
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        async with lidar.record(tmp_path / "run.mcap") as other:
            with pytest.raises(CannotRecord, match=r"run\.mcap is written by another recorder"):
                await lidar.record(tmp_path / "run.mcap", overwrite=True).start()
            with pytest.raises(CannotRecord, match="by another recorder"):
                must_be_writable(tmp_path / "run.mcap", overwrite=True)
            await lidar.scan()
        assert other.error is None
        async with lidar.record(tmp_path / "run.mcap", overwrite=True):
            await lidar.scan()


LEFT = (
    FORKS
    + """
import asyncio, os, signal, sys, time, lidario

async def main():
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        async with lidar.record(sys.argv[1], split_s=60.0):
            child = os.fork()
            if child == 0:
                time.sleep(60)
                os._exit(0)
        async with lidar.record(sys.argv[1], split_s=60.0, keep_bytes=10**6):
            print("goes on")
    os.kill(child, signal.SIGKILL)

asyncio.run(main())
"""
)


@pytest.mark.long
def test_a_forked_child_that_lives_on_holds_no_file(tmp_path: Path) -> None:
    with child(LEFT, str(tmp_path / "run.mcap")) as program:
        assert program.communicate(timeout=BOUND) == ("goes on\n", "")


def test_a_file_that_goes_while_the_files_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those behind it were not counted, and stayed for ever."""
    files = [tmp_path / f"run-2020010{day}T000000Z.mcap" for day in range(1, 6)]
    for file in files:
        file.write_bytes(bytes(300_000))

    @contextmanager
    def going(folder: Path) -> Iterator[list[os.DirEntry[str]]]:
        entries = sorted(scandir(folder), key=attrgetter("name"))
        files[0].unlink(missing_ok=True)
        yield entries

    scandir = os.scandir
    monkeypatch.setattr(os, "scandir", going)
    record(tmp_path / "run.mcap", "sim://rplidar-s2?via=memory", 1, split_s=60.0, keep_bytes=10**6)
    assert [file.exists() for file in files] == [False, False, True, True, True]
