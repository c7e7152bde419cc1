"""Several lidars as one: which scans belong together, the LaserScan of a cloud, and the stream."""

import asyncio
import gc
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np
import pytest

import lidario
from lidario import Busy, InvalidValue, Mount, Velocity
from lidario.filters import AngularBoundsFilter
from lidario.scans.merging import Merged, MergedScans
from lidario.session.merged import MergedStream
from lidario.testing import SimulatedLidar, make_scan, room
from tests.support.cable import on_a_cable
from tests.support.devices import left_still, make_rig
from tests.support.loop import driven

ALL = np.linspace(-math.pi, math.pi, 360, endpoint=False)
MS = 1_000_000


def at(end_ms: float, distance: float = 2.0) -> lidario.Scan:
    """A scan of 100 ms that ends then."""
    return make_scan(ALL, distance, stamp_ns=round((1000 + end_ms - 100) * MS), intensities=7)


def pair(scans: MergedScans, one: lidario.Scan, two: lidario.Scan) -> Merged:
    """The cloud of both."""
    scans.take(0, one)
    scans.take(1, two)
    found = scans.take(0, one)
    assert found is not None
    assert not found.missing
    return found


async def test_the_time_of_a_scan_is_that_of_a_revolution() -> None:
    """Of a lidar that sees three quarters of a turn, it was the time of these."""
    async with lidario.open_lidar("sim://hokuyo-ust10lx?via=memory") as lidar:
        scan = await lidar.scan()
    found = MergedScans([Mount()]).take(0, scan)
    assert found is not None
    assert scan.duration_ns * 1e-9 < 0.02
    assert found.scan_time == found.to_laserscan().scan_time == pytest.approx(0.025, rel=1e-3)


def test_a_cloud_is_made_when_each_has_a_new_scan() -> None:
    scans = MergedScans([Mount(), Mount(1.0)])
    first = scans.take(0, at(0))
    assert first is not None
    assert first.missing == (1,)
    ready = [scans.take(*each) for each in [(1, at(10)), (0, at(100)), (1, at(110, 3.0)), (0, at(210))]]
    assert [found is not None for found in ready] == [False, True, False, True]
    last = ready[-1]
    assert last is not None
    assert (last.at_ns, last.missing) == (1210 * MS, ())
    assert set(last.points.source.tolist()) == {0, 1}
    assert last.points.xy[last.points.source == 1][:, 0].max() == pytest.approx(4.0)


def test_one_that_is_slow_holds_nobody_up_and_one_that_is_silent_is_told() -> None:
    scans = MergedScans([Mount(), Mount()])
    scans.take(1, at(0))
    found = [scans.take(0, at(end)) for end in (100, 200, 300, 400)]
    made = [each for each in found if each is not None]
    assert [each.missing for each in made][-2:] == [(1,), (1,)]
    assert len(made) >= 3
    assert set(made[-1].points.source.tolist()) == {0}


def test_the_robot_moves_meanwhile() -> None:
    scans = MergedScans([Mount(), Mount()], Velocity(x=1.0))
    found = pair(scans, at(0), at(50))
    first = make_scan(ALL, 2.0, stamp_ns=900 * MS).points(Mount(), motion=Velocity(x=1.0), at_ns=1050 * MS)
    assert found.points.xy[found.points.source == 0] == pytest.approx(first.xy)


@pytest.mark.parametrize("beams", [1, 7, 360, 720, 1000])
def test_the_laserscan_against_a_slow_reference(beams: int) -> None:
    """Where the grid is finer than the samples, what lies between two returns is unknown, and not free."""
    draw = np.random.default_rng(beams)
    mounts = Mount(0.3, 0.1, 0.5), Mount(-0.2, 0.0, math.pi)
    made = []
    for stamp_ns in (900 * MS, 905 * MS):
        ranges = draw.uniform(0.02, 5.0, 360)
        # In whole sectors, so that some directions are seen by no sample that says more.
        ranges[slice(*sorted(draw.integers(0, 360, 2)))] = np.nan
        scan = make_scan(ALL, ranges, stamp_ns=stamp_ns, intensities=9)
        begin = draw.uniform(0.0, 5.0)
        made.append(scan.filtered(AngularBoundsFilter([(begin, begin + 1.0)], invert=True)))
    found = pair(MergedScans(mounts), *made)
    message = found.to_laserscan(
        beams, frame_id="base", range_min=0.5, range_max=4.0, no_return="inf", filtered="zero"
    )

    def beam_of(x: float, y: float) -> int:
        return round((math.atan2(y, x) + math.pi) / (math.tau / beams)) % beams

    expected = [math.nan] * beams
    for order, word in enumerate((0.0, math.inf)):
        for scan, mount in zip(made, mounts, strict=True):
            for angle, back, out in zip(scan.angles, scan.valid, scan.left_out, strict=True):
                if not back and out != order:
                    turned = float(angle) + mount.yaw
                    expected[beam_of(mount.x + 40 * math.cos(turned), mount.y + 40 * math.sin(turned))] = word
    for x, y in found.points.xy.tolist():
        if math.hypot(x, y) > 4.0:
            expected[beam_of(x, y)] = math.inf
    for x, y in found.points.xy.tolist():
        distance = math.hypot(x, y)
        if 0.5 <= distance <= 4.0 and not 0.0 < expected[beam_of(x, y)] <= distance:
            expected[beam_of(x, y)] = distance
    assert message.ranges == pytest.approx(np.array(expected), nan_ok=True, abs=1e-5)
    assert message.stamp_ns == found.wall_at_ns
    assert (message.angle_min, message.frame_id, message.time_increment) == (-math.pi, "base", 0.0)
    assert set(message.intensities.tolist()) <= {0.0, 9.0}


def test_nothing_came_back_is_not_nobody_looked() -> None:
    """One lidar sees the front, nothing in a part of it, and has a post filtered out; the other one is away."""
    front = np.radians(np.arange(-90.0, 90.0, 0.5))
    ranges = np.where(front > 1.0, np.nan, 2.0)
    scan = make_scan(front, ranges, max_range=12.0).filtered(AngularBoundsFilter([(-1.0, -0.8)], invert=True))
    found = MergedScans([Mount(), Mount(-0.3)]).take(0, scan)
    assert found is not None
    for word, left in (("nan", math.nan), ("inf", math.inf)):
        message = found.to_laserscan(720, filtered=word)  # type: ignore[arg-type]
        turned = message.angle_min + message.angle_increment * np.arange(720)
        assert np.isinf(message.ranges[(turned > 1.01) & (turned < 1.56)]).all()
        assert np.isnan(message.ranges[abs(turned) > 1.58]).all()
        assert message.ranges[abs(turned) < 0.79] == pytest.approx(2.0)
        post = message.ranges[(turned > -0.99) & (turned < -0.81)]
        np.testing.assert_array_equal(post, np.full(len(post), left, np.float32))


def test_what_cannot_be() -> None:
    with pytest.raises(InvalidValue, match="one lidar to 256"):
        MergedScans([])
    with pytest.raises(InvalidValue, match="oldest_s"):
        MergedScans([Mount()], oldest_s=0.0)
    found = MergedScans([Mount()]).take(0, at(0))
    assert found is not None
    with pytest.raises(InvalidValue, match="range_min must be between"):
        found.to_laserscan(range_min=3.0, range_max=2.0)
    with pytest.raises(InvalidValue, match="filtered must be one of inf, nan, zero"):
        found.to_laserscan(filtered="none")  # type: ignore[arg-type]
    with pytest.raises(InvalidValue, match="takes open lidars, not 'x'"):
        lidario.merged("x")  # type: ignore[arg-type]


@pytest.mark.long
async def test_two_lidars_are_read_as_one() -> None:
    """Each stands 0.5 m off the middle of one room; put together, all points lie on its walls."""
    walls = room(6.0, 4.0)
    seen_by_one = [((x1 - 0.5, y1), (x2 - 0.5, y2)) for (x1, y1), (x2, y2) in walls]
    seen_by_two = [((-x1 - 0.5, -y1), (-x2 - 0.5, -y2)) for (x1, y1), (x2, y2) in walls]
    mounts = [Mount(0.5), Mount(-0.5, 0.0, math.pi)]
    one, two = SimulatedLidar("rplidar-s2", walls=seen_by_one), SimulatedLidar("ydlidar-4ros", walls=seen_by_two)
    async with lidario.open_lidar(one) as front, lidario.open_lidar(two) as rear:
        with pytest.raises(InvalidValue, match="do not say where"):
            lidario.merged(front, rear)
        with pytest.raises(InvalidValue, match="mounts of 2 lidars are a list with one for each"):
            lidario.merged(front, rear, mounts=mounts[:1])
        with pytest.raises(InvalidValue, match="mounts of 1 lidar are a list"):
            lidario.merged(front, mounts=mounts)
        whole: list[Merged] = []
        async with lidario.merged(front, rear, mounts=mounts) as clouds:
            async for cloud in clouds:
                if not cloud.missing:
                    whole.append(cloud)
                if len(whole) == 3:
                    break
            waiting = asyncio.ensure_future(anext(clouds))
            await asyncio.sleep(0)
            with pytest.raises(lidario.Busy):
                await anext(clouds)
            waiting.cancel()
            await asyncio.wait([waiting])
            assert len(await anext(clouds)) > 0
        await front.stop()
        await rear.stop()
    for cloud in whole:
        off = np.minimum(abs(abs(cloud.points.xy[:, 0]) - 2.0), abs(abs(cloud.points.xy[:, 1]) - 3.0))
        assert np.quantile(off, 0.99) < 0.03
        assert set(cloud.points.source.tolist()) == {0, 1}
    assert one.is_still
    assert two.is_still


@pytest.mark.long
async def test_where_the_reader_is_slow_none_is_missing_and_the_latest_scans_win() -> None:
    devices = [SimulatedLidar() for _ in range(3)]
    async with (
        lidario.open_lidar(devices[0]) as front,
        lidario.open_lidar(devices[1]) as left,
        lidario.open_lidar(devices[2]) as right,
        lidario.merged(front, left, right, mounts=[Mount()] * 3) as clouds,
    ):
        first = await anext(clouds)
        for _ in range(5):
            await asyncio.sleep(0.55)
            cloud = await anext(clouds)
            assert cloud.missing == ()
        # Each time the next one would be half a second in all.
        assert cloud.at_ns - first.at_ns > 1_500_000_000


@asynccontextmanager
async def two_merged(
    one: SimulatedLidar | None = None, two: SimulatedLidar | None = None
) -> AsyncIterator[tuple[lidario.Lidar, lidario.Lidar, MergedStream]]:
    """Two lidars that are open, and a stream of both."""
    async with (
        lidario.open_lidar(one or SimulatedLidar()) as front,
        lidario.open_lidar(two or SimulatedLidar()) as rear,
    ):
        yield front, rear, lidario.merged(front, rear, mounts=[Mount(), Mount()])


@pytest.mark.long
async def test_it_goes_on_with_one_and_ends_with_the_last() -> None:
    one, two = SimulatedLidar(), SimulatedLidar()
    async with two_merged(one, two) as (front, rear, stream):
        assert await anext(stream) is not None
        await front.stop()
        async with asyncio.timeout(30):
            # The other one goes on, and it is told which one is missing.
            while (await anext(stream)).missing != (0,):
                pass
        assert one.is_still
        await rear.stop()
        assert [cloud async for cloud in stream if False] == []
        with pytest.raises(StopAsyncIteration):
            await anext(stream)
        assert two.is_still


@driven
@pytest.mark.parametrize("away", [False, True])
async def test_a_reader_that_leaves_by_break_is_no_reader_any_more(away: bool) -> None:
    """Also where the line of one is lost, and no scan comes that would end the waiting for it."""
    other = make_rig("ydlidar")
    async with on_a_cable("rplidar") as (cable, front), other.open() as rear:
        async for _ in lidario.merged(front, rear, mounts=[Mount(), Mount()]):
            if away:
                cable.pull()
            break
        gc.collect()
        await asyncio.sleep(3.0)
        assert not front.is_scanning
        assert left_still(other)
        assert away or left_still(cable.rig)


@driven
async def test_a_reader_that_is_cancelled_is_no_reader_any_more() -> None:
    """Also where the program keeps its task, which holds the error, and so the frames that the error has passed."""
    rig = make_rig("rplidar")
    async with rig.open() as lidar:

        async def read() -> None:
            async for _ in lidario.merged(lidar, mounts=[Mount()]):
                pass

        reading = asyncio.create_task(read())
        await asyncio.sleep(1.0)
        assert lidar.is_scanning
        reading.cancel()
        await asyncio.sleep(2.0)
        assert left_still(rig)
        assert reading.cancelled()
        clouds = lidario.merged(lidar, mounts=[Mount()])
        ends = await asyncio.gather(anext(clouds), anext(clouds), return_exceptions=True)
        assert isinstance(ends[1], Busy)
        del clouds
        await asyncio.sleep(2.0)
        assert left_still(rig)


async def test_a_reader_ends_when_another_task_closes_its_stream() -> None:
    async with lidario.open_lidar(SimulatedLidar()) as lidar:
        clouds = lidario.merged(lidar, mounts=[Mount()])
        assert len(await anext(clouds)) > 0
        waiting = asyncio.ensure_future(anext(clouds, None))
        await asyncio.sleep(0)
        await clouds.close()
        assert await waiting is None


@pytest.mark.parametrize("turns", range(1, 4))
async def test_closing_that_is_cancelled_is_cancelled(turns: int) -> None:
    async with two_merged() as (front, rear, clouds):
        assert len(await anext(clouds)) > 0
        closing = asyncio.ensure_future(clouds.close())
        for _ in range(turns):
            await asyncio.sleep(0)
        ends = closing.cancel()
        await asyncio.wait([closing])
        assert closing.cancelled() is ends
        assert not front.is_scanning
        assert not rear.is_scanning


async def test_a_stream_goes_on_where_the_program_cancels_all_tasks_and_reads_on() -> None:
    async with two_merged() as (_, _, stream), stream as clouds:
        await anext(clouds)
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
        async with asyncio.timeout(30):
            while (await anext(clouds)).missing:
                pass


@pytest.mark.long
@pytest.mark.parametrize("fault", ["", "unplug:1s"])
async def test_an_error_of_one_ends_all(fault: str) -> None:
    """It is raised, and nothing else is told to the loop."""
    told = list[object]()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: told.append(context))
    one, two = SimulatedLidar(fault=fault), SimulatedLidar(fault="unplug:1s")
    async with two_merged(one, two) as (front, _, clouds):
        with pytest.raises(lidario.DeviceLost):
            async for _ in clouds:
                pass
        if not fault:
            await front.stop()
            assert one.is_still
    gc.collect()
    assert not told
