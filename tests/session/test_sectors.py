"""Sectors as a user reads them: beside scans, by several readers, over interruptions, recordings, lost lines."""

import asyncio
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidario
from lidario import InvalidValue, Lidar, Scan, Sector
from lidario.basics.arguments import parts_of
from lidario.port.line import Schedule
from lidario.port.port import Port
from lidario.revolution.whole import sectors_of
from lidario.sync.lidar import open_sync
from tests.support.cable import on_a_cable
from tests.support.devices import EVERY_FAMILY, Rig, left_still, make_rig, some
from tests.support.loop import now, run_driven
from tests.support.recorded import record
from tests.support.samples import long_but_some


def is_the_scan(scan: Scan, sectors: list[Sector]) -> bool:
    parts = [sector for sector in sectors if sector.seq == scan.seq]
    return bool(parts) and all(
        np.array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(scan, name), equal_nan=True)
        for name in ("angles", "ranges", "device_angles", "device_distances")
    )


@pytest.mark.parametrize("rig", long_but_some(*EVERY_FAMILY), indirect=True)
async def test_scans_and_sectors_are_read_at_once(rig: Rig) -> None:
    async with rig.open() as lidar:
        async with lidar.scans(depth=9) as scans, lidar.sectors(depth=99) as eighths, lidar.sectors(60) as sixths:
            first = asyncio.ensure_future(anext(scans))
            second = asyncio.ensure_future(some(eighths, 32))
            third = await some(sixths, 18)
            sectors = await second
            seen = [await first, *await some(scans, 3)]
        assert left_still(rig)
    assert [(each.seq, each.index) for each in sectors[8:]] == [
        (seq, index) for seq in range(sectors[8].seq, sectors[8].seq + 3) for index in range(8)
    ]
    assert {each.degrees for each in sectors} == {45.0}
    assert len({each.wall_stamp_ns - each.stamp_ns for each in (*seen, *sectors)}) == 1
    assert {each.index for each in third} == set(range(6))
    together = [scan for scan in seen if {each.index for each in sectors if each.seq == scan.seq} == set(range(8))]
    assert len(together) >= 2
    assert all(is_the_scan(scan, sectors) for scan in together)


async def test_a_sector_comes_when_it_was_measured(rig: Rig) -> None:
    async with rig.open() as lidar, lidar.sectors() as sectors:
        await some(sectors, 9)
        late = []
        for _ in range(16):
            sector = await anext(sectors)
            late.append(now() - (sector.stamp_ns + sector.duration_ns) * 1e-9)
    # The packet behind the end of the sector must come first, and one more may lie across it.
    assert max(late) < 0.010
    assert rig.turn_s / 8 < 0.02


async def test_they_may_be_asked_for_while_scans_come(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """From then on a port is polled for each of them, not only once in a revolution."""
    schedules: list[Schedule] = []
    monkeypatch.setattr(Port, "set_polling", lambda _, schedule: schedules.append(schedule))
    async with rig.read() as (lidar, scans):
        scan = await anext(scans)
        assert schedules[-1].due - now() > 0.75 * rig.turn_s
        rests = []
        async with lidar.sectors(depth=99) as sectors:
            for sector in await some(sectors, 8):
                assert sector.seq > scan.seq
            for _ in range(16):
                await anext(sectors)
                rests.append(schedules[-1].due - now())
        assert lidar.stats.interruptions == 0
    assert 0 < max(rests) < 1.2 * rig.turn_s / 8


async def test_a_question_interrupts_them_and_they_go_on(rig: Rig) -> None:
    async with rig.open() as lidar, lidar.sectors(depth=99) as sectors:
        before = await some(sectors, 12)
        await lidar.get_health()
        after = await some(sectors, 40)
        stats = lidar.stats
    names = [(each.seq, each.index) for each in after[-16:]]
    assert names == sorted(names)
    assert after[-1].seq > before[-1].seq
    assert stats.interruptions == 1
    assert stats.lost_packets == 0


NO_SIZES: list[Any] = [0, -45, 7, 361, 800, 4, 360 / 73, float("nan"), float("inf"), "wide", None]


async def test_a_revolution_has_up_to_72_sectors() -> None:
    wrong = list(NO_SIZES)
    for parts in (1, 2, 7, 71, 72):
        assert parts_of(360 / parts) == parts_of(360 / parts * (1 + 9e-7)) == parts
        wrong += [360 / parts * (1 + 2e-6), 360 / parts * 0.999]
    async with make_rig("rplidar").open() as lidar:
        for degrees in wrong:
            with pytest.raises(InvalidValue, match="5 degrees"):
                lidar.sectors(degrees)
        with pytest.raises(InvalidValue, match="at least one sector"):
            lidar.sectors(depth=0)


@pytest.mark.long
def test_without_await(rig: Rig) -> None:
    with open_sync(rig.device) as lidar:
        sectors = []
        # The clock is real: a reader that is late finds what has come since, and numbers tell what passed unseen.
        with lidar.sectors(90, depth=99) as stream:
            for sector in stream:
                sectors.append(sector)
                if len(sectors) == 6:
                    break
            assert stream.dropped == 0
        assert [each.index for each in sectors] == [0, 1, 2, 3, 0, 1]
        assert len({each.seq for each in sectors[:4]}) == len({each.seq for each in sectors[4:]}) == 1
        assert sectors[4].seq > sectors[3].seq
    assert (lidario.SyncLidar.sectors.__doc__ or "").replace("``for``", "``async for``") == Lidar.sectors.__doc__


async def test_they_go_on_after_the_line_was_lost(rig: Rig) -> None:
    async with on_a_cable(rig) as (cable, lidar):
        async with lidar.sectors(depth=99) as sectors:
            before = (await some(sectors, 20))[-1]
            cable.pull()
            await asyncio.sleep(2.0)
            cable.plug()
            while (first := await anext(sectors)).stamp_ns < before.stamp_ns + 2_000_000_000:
                pass
            after = await some(sectors, 16)
        assert (lidar.stats.reconnects, first.index) == (1, 0)
        gap_s = (first.stamp_ns - before.stamp_ns) * 1e-9
        assert abs(first.seq - before.seq - gap_s / rig.turn_s) <= 2
        assert after[-1].seq == first.seq + 2
        assert lidar.stats.scans + lidar.stats.missed_scans == first.seq + 2


async def test_a_scan_that_came_whole_is_divided(rig: Rig) -> None:
    """As over zenoh, where nothing but whole scans arrive."""
    async with rig.open() as lidar:
        scan = await lidar.scan()
    parts = list(sectors_of(scan, 8))
    assert [part.index for part in parts] == list(range(8))
    assert is_the_scan(scan, parts)
    np.testing.assert_array_equal(np.concatenate([part.times_ns for part in parts]), scan.times_ns)
    assert sum(part.duration_ns for part in parts) == scan.duration_ns
    assert {part.wall_stamp_ns - part.stamp_ns for part in parts} == {scan.wall_stamp_ns - scan.stamp_ns}
    # Angles that are corrected may stand before the seam.
    angles = np.array(scan.device_angles)
    angles[:2] = 359.5, 359.9
    again = sectors_of(replace(scan, device_angles=angles), 8)
    assert [len(part) for part in again] == [len(part) for part in parts]
    # A part of which nothing came is stepped over.
    for missing in (range(3), range(2, 5), range(6, 8)):
        kept = np.isin((scan.device_angles // 45.0).astype(int), missing, invert=True)
        less = replace(
            scan,
            device_angles=scan.device_angles[kept],
            device_distances=scan.device_distances[kept],
            intensities=None if scan.intensities is None else scan.intensities[kept],
            lost_packets=7,
        )
        parts = list(sectors_of(less, 8))
        assert [part.index for part in parts] == [index for index in range(8) if index not in missing]
        assert [part.lost_packets for part in parts] == [7, *[0] * (len(parts) - 1)]


def test_of_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    record(path, "sim://rplidar-s2", 5)

    async def play() -> tuple[list[Scan], list[Sector]]:
        async def read() -> list[Scan]:
            return [scan async for scan in lidar.scans()]

        async with lidario.open_lidar(f"{path}?rate=0") as lidar:
            reading = asyncio.ensure_future(read())
            sectors = [sector async for sector in lidar.sectors()]
            return await reading, sectors

    scans, sectors = run_driven(play)
    assert len(scans) >= 4
    assert sum(is_the_scan(scan, sectors) for scan in scans) >= len(scans) - 1


@pytest.mark.long
@pytest.mark.parametrize(
    ("source", "packet_ms"),
    [("sim://ldrobot-ld06?fault=drop:0.1%25", 2.7), ("sim://ydlidar-x4?fault=drop:0.3%25", 8)],
)
async def test_time_does_not_go_back_where_packets_are_lost(source: str, packet_ms: float) -> None:
    """How many are missing is not known exactly; a sector began 9 ms before the one before it."""
    found: list[Sector] = []
    async with lidario.open_lidar(f"{source}&via=memory") as lidar, lidar.sectors(15.0, depth=100) as sectors:
        while len(found) < 400:
            found.append(await anext(sectors))
    for one, other in pairwise(found):
        assert one.stamp_ns <= other.stamp_ns
        assert one.stamp_ns + one.duration_ns - other.stamp_ns < packet_ms * 1e6
