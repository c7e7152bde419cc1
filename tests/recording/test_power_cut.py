"""The power goes: what the disk was told to write is there, and is readable.

What a disk holds is taken for what was in the file when it was told to write; no power was cut.
"""

import asyncio
import errno
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import lidario
from lidario.recording.decode_file import FileDecoder
from lidario.scan import Scan
from tests.support.loop import driven, run_driven

pytestmark = pytest.mark.long
SOURCE = "sim://rplidar-s2?via=memory&world=circle"
SCANS = 30


async def recorded(path: Path, *, sync: bool = True) -> tuple[list[Scan], list[float]]:
    """Some seconds at true pace: the scans, and when each was there."""
    scans, times = list[Scan](), list[float]()
    async with lidario.open_lidar(SOURCE) as lidar, lidar.record(path, sync=sync), lidar.scans(depth=64) as stream:
        async for scan in stream:
            scans.append(scan)
            times.append(time.monotonic())
            if len(scans) == SCANS:
                break
    return scans, times


def told(monkeypatch: pytest.MonkeyPatch, instead: Callable[[int], None]) -> None:
    monkeypatch.setattr("lidario.recording.write.os.fsync", instead)


def test_what_the_disk_has_is_readable_and_nearly_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, disk = tmp_path / "a.mcap", list[tuple[float, Path]]()
    sync = os.fsync

    def take(handle: int) -> None:
        sync(handle)
        copy = tmp_path / f"disk-{len(disk)}.mcap"
        shutil.copy(path, copy)
        disk.append((time.monotonic(), copy))

    told(monkeypatch, take)
    scans, times = asyncio.run(recorded(path))
    # The first is the folder, the second the head of the file, the last one the whole of it.
    assert len(disk) >= 5
    for at, copy in disk[2:]:
        kept = [scan.stamp_ns for scan in FileDecoder(copy)]
        assert kept == [scan.stamp_ns for scan in scans][: len(kept)]
        # A second that is collected, a quarter until the thread looks, and what a busy machine adds; ten a second.
        missing = sum(come < at for come in times) - len(kept)
        assert missing <= 20
    assert len(list(FileDecoder(disk[-1][1]))) >= SCANS


def test_who_does_not_want_it_waits_for_no_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told(monkeypatch, lambda _: pytest.fail("the disk was told to write"))
    scans, _ = run_driven(lambda: recorded(tmp_path / "a.mcap", sync=False))
    assert len(scans) == SCANS


@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOTSUP])
def test_a_file_system_that_cannot_is_none_that_fails(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: int) -> None:
        raise OSError(number, os.strerror(number))

    told(monkeypatch, refuse)
    run_driven(lambda: recorded(tmp_path / "a.mcap"))
    assert len(list(FileDecoder(tmp_path / "a.mcap"))) >= SCANS


@driven
async def test_a_failing_disk_ends_the_recording_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    count = 0

    def fail(_: int) -> None:
        nonlocal count
        count += 1
        if count > 2:  # neither the folder nor the head of the file
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    told(monkeypatch, fail)
    async with lidario.open_lidar(SOURCE) as lidar, lidar.scans() as stream:
        async with lidar.record(tmp_path / "a.mcap") as recording:
            while recording.error is None:
                await anext(stream)
        await anext(stream)
    assert "input/output error" in str(recording.error)
