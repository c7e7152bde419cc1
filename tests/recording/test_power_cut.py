"""The power goes: what the disk was told to write is there, and is readable.

What a disk holds is taken for what was in the file when it was told to write; no power was cut.
"""

import errno
import os
import shutil
import threading
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest

import lidario
from lidario.recording.decode_file import FileDecoder
from lidario.scans.scan import Scan
from tests.support.devices import some
from tests.support.loop import driven, run_driven

pytestmark = pytest.mark.long
SOURCE = "sim://rplidar-s2?via=memory&world=circle"
SCANS = 30


async def recorded(path: Path, *, sync: bool = True) -> list[Scan]:
    """Some seconds of scans."""
    async with lidario.open_lidar(SOURCE) as lidar, lidar.record(path, sync=sync), lidar.scans(depth=64) as stream:
        return await some(stream, SCANS)


def stamps_in(path: Path) -> list[int]:
    """Of the scans of a file; none where no stream has begun in it."""
    with suppress(lidario.RecordingError):
        return [scan.stamp_ns for scan in FileDecoder(path)]
    return []


def told(monkeypatch: pytest.MonkeyPatch, instead: Callable[[int], None]) -> None:
    monkeypatch.setattr("lidario.recording.write.os.fsync", instead)


def test_each_second_is_readable_on_the_disk_a_quarter_of_one_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, disk, sync = tmp_path / "a.mcap", list[Path](), os.fsync
    waits = set[float | None]()

    def take(handle: int) -> None:
        sync(handle)
        disk.append(Path(shutil.copy(path, tmp_path / f"disk-{len(disk)}.mcap")))

    class Looked(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            waits.add(timeout)
            return super().wait(0.001)

    told(monkeypatch, take)
    monkeypatch.setattr("lidario.recording.record.threading", SimpleNamespace(Event=Looked))
    stamps = [scan.stamp_ns for scan in run_driven(lambda: recorded(path))]
    # The first is the folder, the second the head of the file, the last one the whole of it.
    kept = [stamps_in(copy) for copy in disk[2:]]
    assert all(each == stamps[: len(each)] for each in kept[:-1])
    assert kept[-1][:SCANS] == stamps
    # Ten scans a second.
    assert max(after - before for before, after in pairwise([0, *map(len, kept)])) <= 11
    assert waits == {0.25}


def test_who_does_not_want_it_waits_for_no_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told(monkeypatch, lambda _: pytest.fail("the disk was told to write"))
    assert len(run_driven(lambda: recorded(tmp_path / "a.mcap", sync=False))) == SCANS


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
