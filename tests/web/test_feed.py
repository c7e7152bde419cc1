"""A feed opens its lidar again, says so, and leaves it still."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import lidario
from lidario import Mount, save_config
from lidario.filters import AngularBoundsFilter
from lidario.web.feed import Feed
from tests.support.loop import driven

S2 = "sim://rplidar-s2?via=memory"


@asynccontextmanager
async def running(feed: Feed, seconds: float) -> AsyncIterator[Feed]:
    """A feed that has run for so long; it ends with the block."""
    task = asyncio.create_task(feed.run())
    await asyncio.sleep(seconds)
    yield feed
    task.cancel()
    await asyncio.wait([task])


@pytest.mark.long
@driven
async def test_it_reads_and_measures_the_line() -> None:
    feed = Feed(S2 + "&fault=drop:0.1%")
    changes: list[str] = []
    feed.on_change = lambda changed: changes.append(changed.state)
    async with running(feed, 6):
        assert changes == ["scanning"]
        assert feed.latest is not None
        assert feed.scans > 20
        assert feed.line is not None
        assert 0.03 < feed.line.damaged < 0.15
        assert feed.line.load == pytest.approx(0.67, abs=0.03)


@pytest.mark.long
@driven
async def test_what_the_settings_leave_out_is_left_out_until_a_viewer_takes_it_away(tmp_path: Path) -> None:
    path, half = tmp_path / "a.toml", AngularBoundsFilter([(0.0, 3.0)], invert=True)
    save_config(path, "", filters=[half])
    async with running(Feed(S2, config=str(path)), 4) as feed:
        assert feed.latest is not None
        np.testing.assert_array_equal(feed.latest.left_out, (feed.latest.angles >= 0) & (feed.latest.angles <= 3))
        feed.removed.append(half)
        await asyncio.sleep(0.5)
        assert not feed.latest.left_out.any()


@pytest.mark.parametrize(("said", "place"), [(None, Mount(1.0)), (Mount(), Mount()), (Mount(2.0), Mount(2.0))])
@driven
async def test_settings_say_where_it_is_unless_callers_do(said: Mount | None, place: Mount, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    save_config(path, "", mount=Mount(1.0))
    async with running(Feed(S2, config=str(path), mount=said), 4) as feed:
        assert feed.place == place


@pytest.mark.long
@driven
async def test_a_lidar_that_was_lost_is_opened_again() -> None:
    feed = Feed(S2 + "&fault=replug:5s")
    changes: list[tuple[str, str]] = []
    feed.on_change = lambda changed: changes.append((changed.state, changed.reason))
    async with running(feed, 9):
        states = [state for state, _ in changes]
        assert states[:3] == ["scanning", "lost", "scanning"]
        assert "unplugged" in changes[1][1]
        assert changes[2][1] == ""
        assert feed.losses == 1
        # In one session: the revolutions that passed meanwhile are counted.
        assert feed.latest is not None
        assert feed.latest.seq > feed.scans


@driven
async def test_the_first_opening_must_succeed() -> None:
    with pytest.raises(lidario.ConnectFailed):
        await Feed(S2 + "&fault=garbage").run()


class Away:
    """`open_lidar` on what goes away; what it was asked to open."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, float]] = []
        self._open_lidar = lidario.open_lidar

    def __call__(self, source: str, *, reconnect: bool, guard: bool, config: lidario.Config) -> object:
        assert reconnect
        assert not guard
        self.asked.append((source, asyncio.get_running_loop().time()))
        if len(self.asked) == 1:
            return self._open_lidar(S2 + "&fault=unplug:3s")
        raise lidario.ConnectFailed("no such port", reason="missing")


@pytest.mark.parametrize("source", ["/dev/ttyUSB0", "run.mcap", "raw.bin", "zenoh:robots/r7/scan"])
@pytest.mark.long
@driven
async def test_nothing_is_opened_again_but_the_source(source: str) -> None:
    """Not the lidar that a recording is of: nobody has asked for it, and its motor would start."""
    away = Away()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lidario, "open_lidar", away)
        async with running(Feed(source), 15) as feed:
            assert (feed.state, feed.reason, feed.losses) == ("lost", "no such port", 1)
            # What was seen last can still be shown.
            assert feed.latest is not None
        assert {asked for asked, _ in away.asked} == {source}
        steps = [later - earlier for (_, earlier), (_, later) in pairwise(away.asked[1:])]
        assert steps[:4] == pytest.approx([0.5, 1.0, 2.0, 2.0])


@pytest.mark.parametrize("after", [0.01, 0.5, 4.0])
@driven
async def test_cancelling_leaves_laser_and_motor_off(after: float) -> None:
    device, open_lidar = lidario.simulate("rplidar-s2"), lidario.open_lidar
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lidario, "open_lidar", lambda _, **how: open_lidar(device, **how))
        async with running(Feed("x"), after):
            pass
    assert not device.scanning
    assert not device.motor_on
