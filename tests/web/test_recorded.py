"""A recording in the page and in the terminal: shown to its end, at any speed, and what ended it is said."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import lidario
from lidario.cli.watch import figures
from lidario.web import server as module
from lidario.web.feed import Feed
from lidario.web.server import LiveServer
from tests.support.cases import CASES
from tests.support.loop import run_driven, until
from tests.support.recorded import record
from tests.web.test_server import BOUND, viewer


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


def test_what_was_played_is_told_also_where_the_first_scans_were_missed(path: Path) -> None:
    """A thousand times as fast all scans but the latest are dropped before the first is shown."""
    feed = Feed(f"{path}?rate=1000")
    run_driven(feed.run)
    assert feed.scans < 4
    assert feed.length_s is not None
    assert feed.reached_s == pytest.approx(feed.length_s, abs=0.2)


async def test_a_recording_without_a_revolution_is_an_error(tmp_path: Path) -> None:
    case = next(case for case in CASES if case.response_type == 0x85)
    short = tmp_path / "short.bin"
    short.write_bytes(case.descriptor + b"".join(case.packets[:10]))
    with pytest.raises(lidario.RecordingError, match="holds no full revolution"):
        await asyncio.wait_for(Feed(f"{short}?rate=0").run(), BOUND)


@pytest.mark.long
async def test_a_recording_at_full_speed_closes_no_viewer(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A viewer that draws at once confirms more scans than it may say anything else."""
    monkeypatch.setattr(module, "STATE_S", 3600.0)
    monkeypatch.setattr(module, "MOST_MESSAGES", 10)
    feed = Feed(f"{path}?rate=0&loop=1")
    async with LiveServer([feed], host="127.0.0.1", port=0) as server:
        feed.on_scan = server.publish_scan
        async with viewer(server) as seen:
            reading = asyncio.create_task(feed.run())
            drawn = 0
            async with asyncio.timeout(BOUND):
                while drawn < 40:
                    if isinstance(await seen.recv(), bytes):
                        drawn += 1
                        await seen.send("a")
            reading.cancel()
            await asyncio.wait([reading])
    assert feed.scans >= drawn


def test_a_recording_is_played_on_from_another_place_also_behind_its_end(path: Path) -> None:
    async def main() -> None:
        feed = Feed(f"{path}?rate=10", stays=True)
        changes: asyncio.Queue[str] = asyncio.Queue()
        feed.on_change = lambda changed: changes.put_nowait(changed.state)
        reading = asyncio.create_task(feed.run())
        assert [await changes.get(), await changes.get()] == ["scanning", "ended"]
        length_s = feed.length_s
        assert length_s is not None
        assert feed.rate == 10
        assert feed.reached_s == pytest.approx(length_s, abs=0.2)
        before = feed.scans
        feed.play_from(length_s / 2, 5.0)
        assert [await changes.get(), await changes.get()] == ["scanning", "ended"]
        # Half of them, and none of the revolutions before.
        assert len(whole) / 2 - 2 <= feed.scans - before <= len(whole) / 2 + 1
        assert feed.rate == 5
        # Where nothing would be left to see it is a little before the end.
        feed.play_from(1e9, 1.0)
        assert [await changes.get(), await changes.get()] == ["scanning", "ended"]
        reading.cancel()
        await asyncio.wait([reading])

    whole = list(lidario.decode_file(path))
    run_driven(main)


@pytest.mark.long
async def test_viewers_move_recordings_and_start_the_recording_of_lidars(path: Path, tmp_path: Path) -> None:
    played = Feed(str(path), stays=True, folder=tmp_path)
    live = Feed("sim://rplidar-s2?via=memory", stays=True, folder=tmp_path)
    async with LiveServer([played, live], host="127.0.0.1", port=0) as server:
        for feed in (played, live):
            feed.on_change = server.publish_states
        reading = [asyncio.create_task(feed.run()) for feed in (played, live)]
        async with viewer(server) as seen:

            async def states(wanted: Callable[[Any, Any], bool]) -> None:
                async with asyncio.timeout(BOUND):
                    while True:
                        message = await seen.recv()
                        if isinstance(message, str) and wanted(*json.loads(message)["lidars"]):
                            return

            await states(lambda one, two: one["play"] is not None and two["state"] == "scanning")
            await seen.send("p0.5 2")
            await states(lambda one, two: one["play"]["rate"] == 2 and two["play"] is None)
            await seen.send("r1")
            await states(lambda one, two: one["record"] is None and two["record"]["scans"] > 2)
            await seen.send("r0")
            await states(lambda _, two: not two["record"]["on"] and two["record"]["error"] == "")
            (made,) = await asyncio.to_thread(lambda: list(tmp_path.glob("*.mcap")))
            assert len(await asyncio.to_thread(lambda: list(lidario.decode_file(made)))) >= 2
            # Anything else is no message of the page.
            await seen.send("p1e9 2")
            async with asyncio.timeout(BOUND):
                await seen.wait_closed()
            assert seen.close_code == 1008
        for task in reading:
            task.cancel()
        await asyncio.wait(reading)


@pytest.mark.long
async def test_a_recording_that_cannot_be_made_says_so_and_the_page_goes_on(tmp_path: Path) -> None:
    live = Feed("sim://rplidar-s2?via=memory", folder=tmp_path / "nowhere")
    assert live.keeper is not None
    reading = asyncio.create_task(live.run())
    live.keeper.ask(on=True)
    keeper = live.keeper
    await until(lambda: keeper.error)
    scans = live.scans
    await until(lambda: live.scans >= scans + 2)
    assert not live.keeper.is_on
    assert "nowhere" in live.keeper.error
    reading.cancel()
    await asyncio.wait([reading])
