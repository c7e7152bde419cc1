"""A file is opened beside the event loop; a replay holds it only for as long as its session."""

import asyncio
import contextlib
import gc
import threading
import weakref
from pathlib import Path

import pytest

import lidario
from lidario.basics.source import Source
from lidario.recording import files
from lidario.recording.read import StoredStreams
from tests.support.loop import driven, run_driven
from tests.support.recorded import record


def test_a_file_is_opened_beside_the_event_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is gone through once, which takes a second for an hour of recording."""
    path = record(tmp_path / "a.mcap", "sim://ydlidar-4ros", 3).path
    turned, really = threading.Event(), files.open_stored_source

    def slow(source: Source, family: str | None = None) -> StoredStreams:
        assert turned.wait(10.0), "the event loop waits for the file"
        return really(source, family)

    monkeypatch.setattr(files, "open_stored_source", slow)

    async def main() -> None:
        asyncio.get_running_loop().call_later(0.01, turned.set)
        async with lidario.open_lidar(path) as lidar:
            assert lidar.info.family == "ydlidar"

    asyncio.run(main())


def test_the_file_is_closed_with_the_session(tmp_path: Path) -> None:
    """At once, not when the garbage is collected."""
    path = record(tmp_path / "a.mcap", "sim://ydlidar-4ros", 5).path

    async def main() -> None:
        async with lidario.open_lidar(f"{path}?rate=0") as lidar, lidar.scans() as stream:
            await anext(stream)
            assert path in open_files()
        assert path not in open_files()

    gc.disable()
    try:
        run_driven(main)
    finally:
        gc.enable()


@driven
async def test_a_recording_that_has_ended_is_let_go(tmp_path: Path) -> None:
    async with lidario.open_lidar("sim://ydlidar-4ros?via=memory") as lidar, lidar.scans() as stream:
        async with lidar.record(tmp_path / "a.mcap") as recording:
            await anext(stream)
        ended = weakref.ref(recording)
        del recording
        gc.collect()
        assert ended() is None
        await anext(stream)


def open_files() -> set[Path]:
    """What this process has open."""
    found = set[Path]()
    for each in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            found.add(each.readlink())
    return found
