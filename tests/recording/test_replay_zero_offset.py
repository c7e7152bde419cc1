"""A replay has the zero offset of its recording, wherever in a stream that was changed."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

import lidario
from lidario.recording.decode_file import FileDecoder
from lidario.recording.export import export_mcap
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar
from tests.support.devices import some
from tests.support.loop import run_driven
from tests.support.recorded import (
    Live,
    assert_same_scans,
    record,
    replayed,
    thread_takes_no_time,
)

OTHER = "sim://ydlidar-4ros"
OTHER_DAMAGED = f"{OTHER}?fault=flip:0.02%25"


async def change_the_offset(lidar: Lidar, live: Live) -> None:
    """Asked for, then left out, added again and left out again, in the midst of revolutions and of packets."""
    async with lidar.scans(depth=64) as stream:
        for wait_s, on in ((0.0, True), (0.03, False), (0.05, True), (0.011, False), (0.0, False)):
            live.scans += [await anext(stream) for _ in range(3)]
            await asyncio.sleep(wait_s)
            await lidar.set_zero_offset(on)
        live.scans += [await anext(stream) for _ in range(3)]


@pytest.mark.long
@pytest.mark.usefixtures("calibrated")
@pytest.mark.parametrize("sectors", [False, True], ids=["", "divided"])
@pytest.mark.exhaustive("source", sample=[OTHER_DAMAGED], full=[OTHER, OTHER_DAMAGED])
def test_another_zero_offset_in_mid_stream_is_replayed(tmp_path: Path, source: str, *, sectors: bool) -> None:
    seen: list[lidario.Sector] = []

    async def count(parts: lidario.SectorStream) -> None:
        async for part in parts:
            seen.append(part)

    async def act(lidar: Lidar, live: Live) -> None:
        if not sectors:
            await change_the_offset(lidar, live)
            return
        async with lidar.sectors(degrees=45) as parts:
            reading = asyncio.create_task(count(parts))
            await change_the_offset(lidar, live)
            reading.cancel()
        assert seen

    live = record(tmp_path / "a.mcap", source, act=act)
    assert len({scan.seam for scan in live.scans}) == 2
    assert_same_scans(live.scans, replayed(live.path))
    assert_same_scans(live.scans, list(lidario.decode_file(live.path)))
    copy = tmp_path / "b.mcap"
    export_mcap(FileDecoder(live.path), copy)
    assert_same_scans(live.scans, list(lidario.decode_file(copy)))


@pytest.mark.long
@pytest.mark.usefixtures("calibrated")
def test_the_zero_offset_that_a_user_of_the_replay_chooses_stays(tmp_path: Path) -> None:
    live = record(tmp_path / "a.mcap", OTHER, act=change_the_offset)

    async def main() -> list[Scan]:
        async with lidario.open_lidar(f"{live.path}?rate=0") as lidar:
            await lidar.set_zero_offset(True)
            return [scan async for scan in lidar.scans()]

    (seam,) = {scan.seam for scan in run_driven(main)}
    assert seam == 10.5 == max(scan.seam for scan in live.scans)


@pytest.mark.long
@pytest.mark.usefixtures("calibrated")
def test_a_recording_that_begins_behind_another_zero_offset(tmp_path: Path) -> None:
    async def main() -> tuple[Scan, list[Scan]]:
        async with lidario.open_lidar("sim://ydlidar-4ros?via=memory") as lidar, lidar.scans(depth=64) as stream:
            await lidar.set_zero_offset(True)
            before = await anext(stream)
            await lidar.set_zero_offset(False)
            async with lidar.record(tmp_path / "a.mcap"):
                return before, await some(stream, 4)

    with thread_takes_no_time():
        before, live = run_driven(main)
    assert before.seam != live[-1].seam
    stored = list(lidario.decode_file(tmp_path / "a.mcap"))
    assert {scan.seam for scan in stored} == {live[-1].seam}
    assert all(
        np.array_equal(one.device_angles, live[-1 - at].device_angles) for at, one in enumerate(stored[::-1])
    )
