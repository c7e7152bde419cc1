"""A recording in the page and in the terminal: shown to its end, at any speed, and what ended it is said."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from websockets.asyncio.client import connect
from websockets.typing import Origin

import lidario
from lidario.cli.watch import figures
from lidario.web import server as module
from lidario.web.feed import Feed
from lidario.web.frames import Mount
from lidario.web.server import LiveServer
from tests.support.cases import CASES
from tests.support.recorded import record

BOUND = 20.0


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("recorded") / "a.mcap", "sim://rplidar-s2", 8).path


async def test_a_recording_is_shown_to_its_end_and_that_is_no_loss(path: Path) -> None:
    feed = Feed(f"{path}?rate=0")
    states: list[str] = []
    feed.on_change = lambda changed: states.append(changed.state)
    await asyncio.wait_for(feed.run(), BOUND)
    assert states == ["scanning", "ended"]
    assert (feed.losses, feed.scans >= 8, feed.latest is not None) == (0, True, True)
    assert dict(figures(feed))["state"] == "the recording has ended"


async def test_a_recording_without_a_revolution_is_an_error(tmp_path: Path) -> None:
    case = next(case for case in CASES if case.response_type == 0x85)
    short = tmp_path / "short.bin"
    short.write_bytes(case.descriptor + b"".join(case.packets[:10]))
    with pytest.raises(lidario.RecordingError, match="holds no full revolution"):
        await asyncio.wait_for(Feed(f"{short}?rate=0").run(), BOUND)


async def test_a_recording_at_full_speed_closes_no_viewer(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A viewer that draws at once confirms more scans than it may say anything else."""
    monkeypatch.setattr(module, "STATE_S", 3600.0)
    monkeypatch.setattr(module, "MOST_MESSAGES", 10)
    feed = Feed(f"{path}?rate=0&loop=1")
    async with LiveServer([feed], [Mount()], host="127.0.0.1", port=0) as server:
        feed.on_scan = server.publish_scan
        own = Origin(f"http://localhost:{server.port}")
        url = f"ws://localhost:{server.port}/live"
        async with connect(url, origin=own, compression=None, max_queue=1000, proxy=None) as viewer:
            reading = asyncio.create_task(feed.run())
            drawn = 0
            async with asyncio.timeout(BOUND):
                while drawn < 40:
                    if isinstance(await viewer.recv(), bytes):
                        drawn += 1
                        await viewer.send("a")
            reading.cancel()
            await asyncio.wait([reading])
    assert feed.scans >= drawn
