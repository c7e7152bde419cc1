"""A recording has a clock of its own, which says nothing of how long the session that plays it waits."""

import asyncio
from pathlib import Path

import pytest

from lidario import open_lidar
from lidario.scan import Scan
from lidario.session.lidar import Lidar
from tests.support.loop import now, run_driven
from tests.support.recorded import Live, assert_same_scans, record

UPTIME_S = 1e5


async def ask_in_between(lidar: Lidar, live: Live) -> None:
    """Interrupted once, on a computer that has run for long."""
    await asyncio.sleep(UPTIME_S)
    async with lidar.scans(depth=64) as stream:
        live.scans += [await anext(stream) for _ in range(2)]
        await lidar.get_health()
        live.scans += [await anext(stream) for _ in range(2)]


@pytest.mark.long
def test_a_computer_that_has_run_for_longer_made_it(tmp_path: Path) -> None:
    """Where a stream ends in it, a quiet line is waited for."""
    live = record(tmp_path / "a.mcap", "sim://rplidar-s2", act=ask_in_between)

    async def main() -> tuple[list[Scan], float]:
        began = now()
        async with open_lidar(f"{live.path}?rate=0") as lidar, lidar.scans() as stream:
            return [scan async for scan in stream], now() - began

    scans, took = run_driven(main)
    assert_same_scans(live.scans, scans)
    assert took < 1.0
