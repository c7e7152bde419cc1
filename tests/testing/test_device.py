"""Simulated lidars of a user's tests: the fast clock, what they see, and what goes wrong when it shall."""

from __future__ import annotations

import asyncio
import math
import selectors
import threading
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

import numpy as np
import pytest

import lidario
from lidario.families.registry import FAMILIES
from lidario.testing import Body, Drive, SimulatedLidar, make_scan, make_sector, room
from lidario.testing.clock import clock_of
from lidario.testing.surroundings import Surroundings

MODELS = [family.simulated[0] for family in FAMILIES if family.make(None).can_be_stopped]
"""One of each family. Those that only talk are never still."""


@pytest.mark.parametrize("model", MODELS)
async def test_opening_a_scan_and_closing_take_a_moment(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As long as with a real one on the clock of the loop, a hundredth of that in waiting, and some computing."""
    lidar = SimulatedLidar(model)
    loop = asyncio.get_running_loop()
    select, waits = selectors.DefaultSelector.select, list[float]()

    def selecting(selector: Any, timeout: float | None = None) -> Any:
        waits.append(timeout or 0.0)
        return select(selector, timeout)

    monkeypatch.setattr(selectors.DefaultSelector, "select", selecting)
    began, used = loop.time(), time.process_time()
    async with lidario.open_lidar(lidar) as session:
        scan = await session.scan()
    took, used = loop.time() - began, time.process_time() - used
    assert 0.2 < took < 2.0
    assert 0 < sum(waits) < took / 50
    assert used < 1.0  # 6 ms
    assert lidar.is_still
    nearest = scan.nearest()
    assert nearest is not None
    assert nearest.range == pytest.approx(2.0, abs=0.01)
    lidar.close()


async def test_the_clock_goes_on_from_where_it_is_at_its_usual_pace() -> None:
    lidar = SimulatedLidar()
    loop = asyncio.get_running_loop()
    async with lidario.open_lidar(lidar):
        await asyncio.sleep(3.0)
    before = loop.time()
    lidar.close()
    lidar.close()
    assert 0 <= loop.time() - before < 1.0
    begun = time.monotonic()
    await asyncio.sleep(0.02)
    assert time.monotonic() - begun >= 0.019


async def test_what_a_thread_brings_is_not_waited_past() -> None:
    """A timeout of ten seconds leaves a thread a hundred milliseconds, and what comes ends the wait at once."""
    lidar = SimulatedLidar()
    loop = asyncio.get_running_loop()
    async with lidario.open_lidar(lidar):
        assert await asyncio.wait_for(asyncio.to_thread(lambda: 7), 600.0) == 7
        come = asyncio.Event()
        thread = threading.Thread(target=loop.call_soon_threadsafe, args=(come.set,))
        thread.start()
        await come.wait()  # no timeout at all
        thread.join()
    lidar.close()


async def test_a_loop_has_one_clock_however_many_lidars() -> None:
    front, rear = SimulatedLidar(seed=1), SimulatedLidar(seed=2, walls=room(6, 6))
    async with lidario.open_lidar(front) as one, lidario.open_lidar(rear) as two:
        scans = await asyncio.gather(one.scan(), two.scan())
        assert [round(float(np.nanmin(scan.ranges))) for scan in scans] == [2, 3]
    clock = clock_of(asyncio.get_running_loop())
    assert clock is not None
    assert clock_of(asyncio.get_running_loop()) is clock
    front.close()
    rear.close()
    assert clock.pace == 1.0


@pytest.mark.long
async def test_real_time_where_that_is_wanted() -> None:
    lidar = SimulatedLidar(pace=1)
    began = time.monotonic()
    async with lidario.open_lidar(lidar):
        pass
    assert time.monotonic() - began > 0.1
    assert clock_of(asyncio.get_running_loop()) is not None


@pytest.mark.long
def test_without_await_it_keeps_real_time() -> None:
    """Else the scans of minutes would pass while the test computes."""
    lidar = SimulatedLidar()
    began = time.monotonic()
    with lidario.open_sync(lidar) as session:
        assert session.scan().nearest() is not None
    assert time.monotonic() - began > 0.1
    assert lidar.is_still


@pytest.mark.long
async def test_a_body_is_where_its_path_says() -> None:
    body = Body([(0, 1.8, 0.0), (1, 1.8, 0.0), (3, 0.8, 0.0)], radius=0.2)
    lidar = SimulatedLidar(bodies=[body])
    async with lidario.open_lidar(lidar) as session, session.scans() as scans:
        first: int | None = None
        async for scan in scans:
            ahead = scan.at(0.0)
            assert ahead is not None
            measured_ns = int(scan.times_ns[ahead.index])
            # The lidar was opened shortly before its first revolution began; the path tells how long.
            if ahead.range < 1.59 and first is None:
                first = measured_ns - round((1.6 - ahead.range) / 0.5 * 1e9)
            if first is not None:
                expected = body.at(1.0 + (measured_ns - first) * 1e-9)[0] - 0.2
                assert ahead.range == pytest.approx(expected, abs=0.01)
            if ahead.range < 0.62:
                break
        # What the first body hides is seen again when another one is shown.
        lidar.show(bodies=[Body([(0, 0.0, 1.0)], 0.3)])
        seen = [scan async for scan in _some(scans, 3)][-1]
        left, ahead = seen.at(math.pi / 2), seen.at(0.0)
        assert left is not None
        assert ahead is not None
        assert left.range == pytest.approx(0.7, abs=0.01)
        assert ahead.range == pytest.approx(2.0, abs=0.01)
        lidar.show(walls=[], bodies=[])
        assert [scan async for scan in _some(scans, 3)][-1].nearest() is None
    lidar.close()


async def _some(scans: lidario.ScanStream, count: int) -> AsyncIterator[lidario.Scan]:
    for _ in range(count):
        yield await anext(scans)


@pytest.mark.parametrize("bearing", [0.0, 1.0, -2.5, math.pi])
def test_a_body_covers_the_angle_that_it_should(bearing: float) -> None:
    distance, radius = 1.5, 0.3
    body = Body([(0, distance * math.cos(bearing), distance * math.sin(bearing))], radius)
    angles = np.linspace(-np.pi, np.pi, 3600, endpoint=False)
    seen = Surroundings([], [body], 0.0, 0).ranges_mm(-np.degrees(angles), np.zeros(3600)) / 1000
    away = np.abs((angles - bearing + np.pi) % math.tau - np.pi)
    half = math.asin(radius / distance)
    assert (seen[away < half - 0.002] > 0).all()
    assert (seen[away > half + 0.002] == 0).all()
    assert seen.max() < math.hypot(distance, radius)
    assert seen[seen > 0].min() == pytest.approx(distance - radius, abs=1e-3)


@pytest.mark.long
async def test_what_goes_wrong_in_the_middle_of_a_stream() -> None:
    lidar = SimulatedLidar()
    async with lidario.open_lidar(lidar) as session:
        with pytest.raises(lidario.StreamFailed):
            async for scan in session.scans():
                if scan.seq == 2:
                    lidar.fail("silent:0s")
        lidar.fail()
        assert await session.scan() is not None
        with pytest.raises(lidario.DeviceLost):
            async for _ in session.scans():
                lidar.fail("unplug:0s")
    lidar.fail()
    async with lidario.open_lidar(lidar) as session:
        assert (await session.scan()).lost_packets == 0
    lidar.close()


async def test_responses_that_were_wrong_are_right_again() -> None:
    lidar = SimulatedLidar()
    async with lidario.open_lidar(lidar) as session:
        lidar.fail("wrong-response:100%")
        lidar.fail()
        asked = len(lidar.requests)
        assert await session.get_info() == session.info
        assert lidar.requests[asked:] == ["get_info"] * 2
    lidar.close()


async def test_it_comes_back() -> None:
    lidar = SimulatedLidar()
    async with lidario.open_lidar(lidar, reconnect=True) as session, session.scans() as scans:
        assert (await anext(scans)).seq == 0
        lidar.fail("replug:0s")
        async for scan in scans:
            if session.stats.reconnects and scan.seq > 5:
                break
        assert session.stats.reconnects == 1
    assert lidar.is_still
    assert lidar.requests.count("get_info") >= 2
    lidar.close()


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda: SimulatedLidar(world="circle", walls=room()), "either a world"),
        (lambda: SimulatedLidar(pace=0), "pace"),
        (lambda: SimulatedLidar(walls=[(1, 2)]), "walls are"),  # type: ignore[list-item]
        (lambda: SimulatedLidar(walls=[((0, 1), (2, math.nan))]), "ends of walls are finite"),
        (lambda: SimulatedLidar(fault="rain"), "no fault is called 'rain'"),
        (lambda: SimulatedLidar("x"), "'x'"),
        (lambda: Body([], 0.2), "path"),
        (lambda: Body([(0, 1)], 0.2), "path"),  # type: ignore[list-item]
        (lambda: Body([(1, 0, 0), (0, 0, 0)], 0.2), "goes back"),
        (lambda: Body([(0, 1, 1)], 0.0), "radius"),
        (lambda: Drive([], room()), "a drive is"),
        (lambda: Drive([(0, 1, 2)], room()), "a drive is"),  # type: ignore[list-item]
        (lambda: Drive([(0, 0, 0, math.nan)], room()), "a drive is"),
        (lambda: Drive("abc", room()), "a drive is"),  # type: ignore[arg-type]
        (lambda: Drive([(1, 0, 0, 0), (0, 0, 0, 0)], room()), "goes forward in time"),
        (lambda: Drive([(0, 0, 0, 0)], [((0, 0), (1, math.inf))]), "ends of walls are finite"),
        (lambda: Drive([(0, 0, 0, 0)], 3), "walls are"),  # type: ignore[arg-type]
        (lambda: make_sector([0.0, 0.5], 1.0, degrees=50), "multiple"),
        (lambda: make_sector([0.0, 0.5], 1.0, degrees=4), "at least 5"),
        (lambda: make_sector([0.0, 0.5], 1.0, index=8), "0 to 7"),
        (lambda: make_sector([0.0, 0.5], 1.0, rpm=0), "rpm"),
        (lambda: make_sector([0.0, 0.5], 1.0, degrees=10), "spread over 28.6"),
        (lambda: make_scan([0, 1], [1, 2, 3]), "2 angles"),
        (lambda: make_scan([math.nan], [1]), "finite"),
        (lambda: make_scan([[0.0]], 1.0), "shape"),
        (lambda: make_scan([0.0], [-1]), "from 0 on"),
        (lambda: make_scan([0.0], 1.0, intensities=256), "255"),
        (lambda: make_scan([0.0], 1.0, rpm=0), "rpm"),
    ],
)
def test_what_cannot_be_right(make: Callable[[], object], why: str) -> None:
    with pytest.raises(lidario.InvalidValue, match=why):
        make()


def test_a_world_by_name_cannot_be_replaced_by_walls() -> None:
    lidar = SimulatedLidar(world="circle")
    with pytest.raises(lidario.InvalidValue, match="another world"):
        lidar.show(walls=[])
    assert "still" in repr(lidar)


# --------------------------------------------------------------------------------------------------- made scans


@pytest.mark.parametrize("model", ["rplidar-a1", "ydlidar-x4"])
async def test_a_motor_that_dtr_switches_stands_at_the_end(model: str) -> None:
    lidar = SimulatedLidar(model)
    async with lidario.open_lidar(lidar) as session:
        await session.scan()
        assert not lidar.is_still
    assert lidar.is_still


def test_a_made_scan_is_in_the_order_of_measuring() -> None:
    angles = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    scan = make_scan(angles, 2.0 + angles / 10, intensities=40, rpm=300)
    assert (np.diff(scan.device_angles) > 0).all()
    ascending = scan.sorted()
    np.testing.assert_allclose(ascending.ranges[1:-1], 2.0 + ascending.angles[1:-1] / 10, atol=1e-5)
    assert scan.duration_ns == 200_000_000
    assert scan.times_ns[-1] - scan.stamp_ns == 359 * (200_000_000 // 360)
    assert scan.intensities is not None
    assert set(scan.intensities.tolist()) == {40}
    assert not scan.device_angles.flags.writeable
    message = scan.to_laserscan(360)
    assert np.isfinite(message.ranges).all()


def test_a_made_scan_without_returns() -> None:
    scan = make_scan([0.0, 1e-9, 0.5], [math.nan, math.inf, 0.0])
    assert scan.nearest() is None
    assert len(make_scan([], [])) == 0
    assert (scan.device_angles < 360).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("metres", [4e36, 1e300, 1.7e308, math.inf])
def test_farther_than_a_scan_can_tell_nothing_comes_back(metres: float) -> None:
    assert make_scan([0.0, 1.0], [metres, 2.0]).valid.tolist() == [False, True]
    assert make_sector([0.0, 0.1], [metres, metres]).nearest() is None


def test_made_sectors_are_those_of_a_made_scan() -> None:
    scan = make_scan(np.linspace(-np.pi, np.pi, 360, endpoint=False) - 1e-3, 2.0, intensities=40, rpm=300)
    at = 0
    for index in range(8):
        inside = (scan.device_angles >= 45 * index) & (scan.device_angles < 45 * (index + 1))
        sector = make_sector(scan.angles[inside][::-1], 2.0, intensities=40, rpm=300)
        assert (sector.index, sector.degrees, sector.is_last) == (index, 45, index == 7)
        np.testing.assert_allclose(sector.device_angles, scan.device_angles[inside], atol=1e-4)
        assert sector.stamp_ns == scan.stamp_ns + index * 25_000_000
        assert abs(int(sector.times_ns[-1]) - int(scan.times_ns[at + len(sector) - 1])) < 1000
        assert (sector.intensities == 40).all()  # type: ignore[union-attr]
        assert not sector.device_distances.flags.writeable
        at += len(sector)
    assert at == len(scan)


def test_a_made_sector_on_both_sides_of_straight_ahead() -> None:
    sector = make_sector([-0.2, 0.0, 0.1], [1.0, 0.5, 2.0])
    assert sector.ranges.tolist() == [2.0, 0.5, 1.0]
    assert sector.index == 0
    assert make_sector([-0.1, 0.2], 1.0, seq=3).index == 7
    assert make_sector([0.5], 1.0, index=2, degrees=30.0).index == 2
    assert len(make_sector([], [])) == 0


@pytest.mark.parametrize("asynchronous", [True, False])
def test_its_time_goes_on_in_the_next_loop(asynchronous: bool) -> None:
    """As of a program that a test starts again: its clock had been fast, and the next loop's was behind it."""
    lidar = SimulatedLidar(bodies=[Body([(0.0, 1.0, 0.0), (60.0, 1.9, 0.0)])])
    stamps, ahead = list[int](), list[float]()

    async def program(scans: int) -> None:
        async with lidario.open_lidar(lidar) as session:
            for _ in range(scans):
                scan = await session.scan()
                stamps.append(scan.stamp_ns)
                ahead.append(float(scan.ranges[np.argmin(np.abs(scan.angles))]))

    asyncio.run(program(100))
    if asynchronous:
        asyncio.run(program(2))
    else:
        with lidario.open_sync(lidar) as session:
            stamps.append(session.scan().stamp_ns)
    assert lidar.is_still
    # About as long as opening takes. It had to catch up with 10 s, and did not respond.
    assert 0 < stamps[100] - stamps[99] < 4e9
    assert all(np.diff(ahead) >= 0)
    lidar.close()
