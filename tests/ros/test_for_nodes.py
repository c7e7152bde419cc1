"""What nodes of ROS 2 need beside the scans: where the lidar is, what time it is; and a lidar that rests unread."""

import asyncio
import math
import time
from dataclasses import replace
from typing import Any

import pytest
from zenoh import ext

import lidario
from lidario.errors import InvalidValue
from lidario.network.keys import parse_attachment
from lidario.ros import MergedPublisher, Publisher, Share
from lidario.ros.names import CLOCK, LASERSCAN, LATEST_KEPT, TF_MESSAGE, Node
from tests.support.loop import driven, until
from tests.support.messages import decoded
from tests.support.network import BOUND_S, Rig, publisher_of, zid_in
from tests.support.router import Router, client

SIM = "sim://rplidar-s2?via=memory"


@pytest.mark.long
async def test_a_node_that_comes_later_learns_where_the_lidar_is(router: Router) -> None:
    node, came = Node(domain=21), list[Any]()
    key = node.data_key("/tf_static", TF_MESSAGE)
    async with Rig(router) as rig:
        tokens: dict[str, bool] = {}
        watching = await rig.bus()
        watching.watch_tokens("@ros2_lv/21/**", tokens.__setitem__)
        publisher = Publisher(
            await rig.open(), domain=21, router=router.address, frame_id="front", mount=(0.2, -0.1, math.pi / 2),
        )  # fmt: skip
        async with publisher:
            await until(lambda: len(tokens) == 4)
            assert node.publisher_token(zid_in(tokens), 3, "/tf_static", TF_MESSAGE, LATEST_KEPT) in tokens
            late = rig.enter_context(client(router.address))
            history = ext.HistoryConfig(detect_late_publishers=True)
            held = ext.declare_advanced_subscriber(late, key, came.append, history=history)
            await until(lambda: came)
            held.undeclare()  # type: ignore[no-untyped-call]
    message = decoded(came[0].payload.to_bytes(), "tf2_msgs/msg/TFMessage")
    (transform,) = message.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("base_link", "front")
    place, turn = transform.transform.translation, transform.transform.rotation
    assert (place.x, place.y, place.z) == (0.2, -0.1, 0.0)
    assert (turn.x, turn.y) == (0.0, 0.0)
    assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(math.pi / 2)
    assert parse_attachment(came[0].attachment.to_bytes()) is not None


@pytest.mark.parametrize(
    ("options", "told"),
    [
        *(({"mount": mount}, "a mount") for mount in ((1.0, 2.0), "0,0,0", (1.0, 2.0, math.nan), 3)),
        ({"mount": (0.0, 0.0, 1.0), "mount_yaw": 1.0}, "would turn it twice"),
    ],
)
@driven
async def test_what_is_no_mount(options: dict[str, Any], told: str) -> None:
    async with lidario.open_lidar(SIM) as lidar:
        with pytest.raises(InvalidValue, match=told):
            Publisher(lidar, **options)


@pytest.mark.long
@pytest.mark.parametrize("stamps", ["now", "measured"])
async def test_stamps_of_a_recording(router: Router, stamps: Any) -> None:
    """Scans of a year ago are of now, or of then, and then /clock tells what time it was."""
    node, scans, clocks = Node(domain=22), list[Any](), list[Any]()
    async with Rig(router) as rig:
        reader = await rig.bus()
        reader.subscribe(node.data_key("/scan", LASERSCAN), scans.append)
        reader.subscribe(node.data_key("/clock", CLOCK), clocks.append)
        lidar = await rig.open()
        publisher = Publisher(lidar, domain=22, router=router.address, stamps=stamps, clock=stamps != "now")
        async with publisher:
            scan = await lidar.scan()
            old = replace(scan, wall_stamp_ns=scan.wall_stamp_ns - 31_536_000_000_000_000)
            for _ in range(2):
                publisher.publish(old)
            await until(lambda: scans and (clocks or stamps == "now"))
    laser = decoded(scans[0].payload)
    at_ns = laser.header.stamp.sec * 10**9 + laser.header.stamp.nanosec
    if stamps == "now":
        # Its first beam was the last one that was measured, just now.
        assert abs(time.time_ns() - at_ns) < BOUND_S * 1e9
        assert not clocks
    else:
        assert at_ns == old.to_laserscan().stamp_ns
        clock = decoded(clocks[0].payload, "rosgraph_msgs/msg/Clock")
        assert clock.clock.sec * 10**9 + clock.clock.nanosec == old.wall_stamp_ns + old.duration_ns


@pytest.mark.long
@pytest.mark.parametrize("form", ["ros", "scan", "raw"])
async def test_a_lidar_that_nobody_reads_rests_until_somebody_does(router: Router, form: str) -> None:
    device = lidario.simulate("rplidar-s2", spin_up=0)
    async with Rig(router) as rig:
        lidar = await rig.open(device)
        publisher = await rig.enter_async_context(publisher_of(lidar, form, f"resting/{form}", rig.router))
        running = rig.work(publisher.run(idle_stop=0.2))
        # Its time counts from the start, so on a slow machine it rests before a first scan is sent.
        await until(lambda: lidar.stats.scans and not device.scanning and not device.motor_on)
        assert [publisher.is_read] == [False]
        reader = await rig.bus()
        came = list[Any]()
        reader.subscribe(publisher.key, came.append)
        await until(lambda: came and device.scanning)
        assert [publisher.is_read] == [True]
        seen = publisher.scans
        # Three times as long as it would scan for nobody.
        await until(lambda: publisher.scans > seen + 6)
        assert device.scanning
        await reader.close()
        await until(lambda: not (device.scanning or device.motor_on))
        assert not running.done()


@pytest.mark.long
@pytest.mark.parametrize("raw", [False, True])
async def test_a_lidar_that_rests_can_be_opened_and_starts(router: Router, raw: bool) -> None:
    device = lidario.simulate("rplidar-s2", spin_up=0)
    async with Rig(router) as rig:
        lidar = await rig.open(device)
        share = await rig.share(f"woken/{raw}", raw=raw, lidar=lidar)
        rig.work(share.run(idle_stop=0.2))
        await until(lambda: share.scans and not device.scanning)
        remote, scans = await rig.take(share.key, 2)
        assert remote.info == lidar.info
        assert [scan.mode for scan in scans] == ["DenseBoost"] * 2


@driven
async def test_it_ends_with_its_session_also_while_its_lidar_rests() -> None:
    device, other = lidario.simulate("rplidar-s2"), lidario.simulate("ydlidar-4ros")
    async with lidario.open_lidar(device) as lidar, lidario.open_lidar(other) as beside:
        mounts = [lidario.Mount(), lidario.Mount()]
        resting = [Share(lidar, "over"), Publisher(lidar), MergedPublisher([beside, lidar], mounts=mounts)]
        running = [asyncio.create_task(each.run(idle_stop=0.2)) for each in resting]
        await asyncio.sleep(10.0)
        assert (device.scanning, other.scanning) == (False, False)
        assert not any(each.done() for each in running)
        await lidar.close()
        for each in running:
            with pytest.raises(lidario.SessionClosed):
                await asyncio.wait_for(each, BOUND_S)


@driven
async def test_stopping_ends_it_also_while_its_lidar_rests() -> None:
    device, other = lidario.simulate("rplidar-s2"), lidario.simulate("ydlidar-4ros")
    async with lidario.open_lidar(device) as lidar, lidario.open_lidar(other) as beside:
        both = MergedPublisher([beside, lidar], mounts=[lidario.Mount(), lidario.Mount()])
        share, *others = (asyncio.create_task(each.run(idle_stop=0.2)) for each in (Share(lidar, "over"), both))
        await asyncio.sleep(10.0)
        await lidar.stop()
        await asyncio.wait_for(share, BOUND_S)
        await asyncio.sleep(1.0)
        assert [each.done() for each in others] == [False]
        await beside.stop()
        await asyncio.wait_for(others[0], BOUND_S)
        assert (device.scanning, other.scanning) == (False, False)


@driven
async def test_a_time_that_is_none() -> None:
    async with lidario.open_lidar(SIM) as lidar:
        with pytest.raises(InvalidValue, match="above 0"):
            await Share(lidar, "never").run(idle_stop=0.0)


@pytest.mark.long
async def test_a_reader_of_its_own_program_goes_on_when_nobody_else_reads(router: Router) -> None:
    device = lidario.simulate("rplidar-s2", spin_up=0)
    async with Rig(router) as rig:
        lidar = await rig.open(device)
        share = await rig.share("resting/own", lidar=lidar)
        rig.work(share.run(idle_stop=0.2))
        async with lidar.scans() as own:
            await until(lambda: share.scans)
            seen = 0
            async with asyncio.timeout(BOUND_S):
                # The publisher has left by then.
                while seen < 6:
                    seen += (await anext(own)).seq > 0
            assert device.scanning
        await until(lambda: not device.scanning)


@pytest.mark.long
async def test_a_reader_that_was_there_before_is_known_and_a_router_that_restarts_forgets_none() -> None:
    router = Router()
    device = lidario.simulate("rplidar-s2", spin_up=0)
    async with Rig(router) as rig:
        rig.callback(router.stop)
        reader = await rig.bus()
        came = list[Any]()
        reader.subscribe("resting/before", came.append)
        lidar = await rig.open(device)
        share = await rig.share("resting/before", lidar=lidar)
        rig.work(share.run(idle_stop=0.2))
        await until(lambda: share.is_read and came)
        router.stop()
        await until(lambda: not share.is_connected and not device.scanning)
        seen = len(came)
        router.start()
        await until(lambda: share.is_read and len(came) > seen)
