"""Through a router, in one process: what is published arrives as it was sent.

Times are real here, since zenoh has threads of its own. Every wait is for an event, with a bound that nothing but a
defect reaches.
"""

import asyncio
import threading
from typing import Any

import numpy as np
import pytest

from lidario.errors import Unsupported
from lidario.network.bus import Sample
from lidario.network.handover import Handover
from lidario.network.keys import parse_attachment
from lidario.ros import Publisher, list_remote_lidars
from lidario.ros.names import DIAGNOSTICS, LASERSCAN, Node, gid_of
from lidario.scans.laserscan import LaserScan
from tests.support.loop import until
from tests.support.messages import decoded
from tests.support.network import BOUND_S, Rig, zid_in
from tests.support.router import Router

pytestmark = pytest.mark.long


@pytest.mark.parametrize(("family", "raw"), [("rplidar", False), ("ydlidar", True)])
async def test_scans_arrive_equal_and_info_and_health_with_them(router: Router, family: str, raw: bool) -> None:
    async with Rig(router) as rig:
        lidar = await rig.open(family)
        key = f"equal/{family}/{raw}"
        rig.run(await rig.share(key, raw=raw, lidar=lidar))
        await until(lambda: rig.sent)
        remote, scans = await rig.take(key, 3)
        await until(lambda: rig.sent[-1].wall_stamp_ns >= scans[-1].wall_stamp_ns)
        by_time = {round(scan.wall_stamp_ns, -5): scan for scan in rig.sent}
        for scan in scans:
            sent = by_time[round(scan.wall_stamp_ns, -5)]
            np.testing.assert_array_equal(scan.device_angles, sent.device_angles)
            np.testing.assert_array_equal(scan.device_distances, sent.device_distances)
            np.testing.assert_array_equal(scan.intensities, sent.intensities)
            assert scan.wall_stamp_ns == sent.wall_stamp_ns
            assert (scan.duration_ns, scan.mode, scan.max_range) == (sent.duration_ns, sent.mode, sent.max_range)
        assert np.all(np.diff([scan.seq for scan in scans]) == 1)
        assert (remote.info, remote.health) == (lidar.info, lidar.health)
        assert await remote.get_health() == lidar.health
        assert remote.mode is not None
        assert remote.mode.name == scans[0].mode
        assert {mode.name for mode in await remote.get_modes()} >= {remote.mode.name}
        with pytest.raises(Unsupported, match="cannot be set from here"):
            await remote.set_scan_frequency(10)
        stats = remote.stats
        assert stats.scans >= 3
        assert stats.dropped_scans == 0
        if raw:
            assert stats.lost_packets == 0


async def test_another_zero_offset_of_raw_bytes_interrupts_no_reader(router: Router) -> None:
    """It had to start its stream again, up to a second later, and lost a revolution."""
    async with Rig(router) as rig:
        lidar = await rig.open("ydlidar")
        await lidar.set_zero_offset(True)
        rig.run(await rig.share("turned", raw=True, lidar=lidar))
        await until(lambda: rig.sent)
        _, stream = await rig.read("turned")
        scans = [await anext(stream) for _ in range(3)]
        await lidar.set_zero_offset(False)
        # The next status tells it again.
        scans += [await anext(stream) for _ in range(12)]
        await until(lambda: rig.sent[-1].wall_stamp_ns >= scans[-1].wall_stamp_ns)
    by_time = {round(scan.wall_stamp_ns, -5): scan for scan in rig.sent}
    assert len({round(float(scan.device_angles[0]), -1) for scan in scans}) == 2
    for scan in scans:
        np.testing.assert_array_equal(scan.device_angles, by_time[round(scan.wall_stamp_ns, -5)].device_angles)
    assert np.all(np.diff([scan.seq for scan in scans]) == 1)


async def test_a_topic_of_ros(router: Router) -> None:
    """Keys, tokens, payload, attachment and diagnostics, as a node would see them; ``zenoh:`` reads it, too."""
    node = Node(domain=9)
    key, health = node.data_key("/front/scan", LASERSCAN), node.data_key("/diagnostics", DIAGNOSTICS)
    tokens: dict[str, bool] = {}
    messages: list[Sample] = []
    diagnostics: list[Any] = []
    async with Rig(router) as rig:
        reader = await rig.bus()
        reader.watch_tokens("@ros2_lv/9/**", tokens.__setitem__)
        reader.subscribe(key, messages.append)
        reader.subscribe(health, diagnostics.append)
        lidar = await rig.open()
        publisher = Publisher(
            lidar,
            topic="front/scan",
            beams=3200,
            frame_id="front",
            domain=9,
            router=router.address,
            robot="r7",
            preset="vendor",
        )
        async with publisher:
            assert publisher.key == key
            await until(lambda: len(tokens) == 3)
            zid = zid_in(tokens)
            scan_token = node.publisher_token(zid, 1, "/front/scan", LASERSCAN)
            assert set(tokens) == {
                node.node_token(zid), scan_token, node.publisher_token(zid, 2, "/diagnostics", DIAGNOSTICS),
            }  # fmt: skip
            async with lidar.scans(depth=64) as stream:
                async for scan in stream:
                    rig.sent.append(scan)
                    publisher.publish(scan)
                    if len(rig.sent) == 3:
                        break
            await until(lambda: len(messages) == 3 and diagnostics)
            (found,) = [
                each for each in await list_remote_lidars(router.address) if each.source == "zenoh:9/front/scan/*/*"
            ]
        await until(lambda: not any(tokens.values()))

    for number, (scan, sample) in enumerate(zip(rig.sent, messages, strict=True), 1):
        assert sample.payload == scan.to_laserscan(3200, frame_id="front", preset="vendor").to_cdr()
        attachment = parse_attachment(sample.attachment)
        assert attachment is not None
        assert (attachment.number, attachment.gid) == (number, gid_of(scan_token))
        assert 0 < attachment.time_ns - scan.wall_stamp_ns < BOUND_S * 1e9
    (status,) = decoded(diagnostics[-1].payload, "diagnostic_msgs/msg/DiagnosticArray").status
    assert (status.level, status.hardware_id, status.name) == (0, lidar.info.serial, "lidario: front/scan")
    assert (found.form, found.robot, found.model) == ("ros", "r7", lidar.info.model)
    assert found.health == lidar.health


async def test_a_laserscan_of_somebody_elses_node_is_a_source(router: Router) -> None:
    key = f"3/urg/scan/{LASERSCAN.dds}/RIHS01_{'0' * 64}"
    laser = LaserScan(
        10**18, "laser", -1.0, 1.0, 0.5, 0.001, 0.1, 0.1, 8.0,
        np.array([1, 2, 3, 4, 5], np.float32), np.zeros(0, np.float32),
    )  # fmt: skip
    async with Rig(router) as rig:
        node = await rig.bus()
        node.token(Node("urg", "/robot1", 3).publisher_token(node.id, 7, "/urg/scan", LASERSCAN))
        sender = node.sender(key, bytes(16))

        async def publish() -> None:
            while True:
                sender.publisher.put(b"junk")
                sender.publisher.put(laser.to_cdr())
                await asyncio.sleep(0.02)

        rig.work(publish())
        lidar, scans = await rig.take("3/urg/scan/*/*", 2)
        assert scans[0].ranges.tolist() == [1, 2, 3, 4, 5]
        assert (lidar.info.family, lidar.info.serial) == ("ros2", "3/urg/scan")
        with pytest.raises(Unsupported, match="its publisher does not tell"):
            await lidar.get_sample_rate()
        found = [each for each in await list_remote_lidars(router.address) if "urg" in each.source]
        assert [(each.source, each.robot, each.model, each.health) for each in found] == [
            ("zenoh:3/urg/scan/*/*", "/robot1/urg", "", None)
        ]


@pytest.mark.parametrize("what", ["messages", "tokens", "queries"])
async def test_no_queue_is_kept_before_the_bus(router: Router, monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    """It does where a thread of Python takes what comes: 256 messages of any size."""
    by_python: list[bool] = []
    put = Handover[Any].put

    def noted(self: Handover[Any], item: Any, size: int) -> int:
        by_python.append(threading.get_ident() in {each.ident for each in threading.enumerate()})
        return put(self, item, size)

    monkeypatch.setattr(Handover, "put", noted)
    key = f"queue/{what}"
    async with Rig(router) as rig:
        reader, other = await rig.bus(), await rig.bus()
        if what == "messages":
            reader.subscribe(key, lambda _: None)
            sender = other.sender(key, b"", keeps_last=True)
            await until(lambda: sender.send(b"x") and by_python)
        elif what == "tokens":
            reader.watch_tokens(key, lambda *_: None)
            other.token(key)
            await until(lambda: by_python)
        else:
            reader.respond(key, lambda: b"")
            # Not at once: the router has to learn of it.
            async with asyncio.timeout(BOUND_S):
                while not await other.query(key, BOUND_S):
                    pass
    assert not any(by_python)
