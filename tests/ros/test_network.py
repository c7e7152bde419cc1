"""Through a router, in one process: what is published arrives as it was sent, and is shown as long as it is there.

Times are real here, since zenoh has threads of its own. Every wait is for an event, with a bound that nothing but a
defect reaches.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

import lidario
from lidario.errors import ConnectFailed, InvalidValue, Unsupported
from lidario.laserscan import LaserScan
from lidario.model import Health, HealthStatus
from lidario.network.bus import Bus, Sample
from lidario.network.keys import Token, parse_attachment, token_key
from lidario.network.status import Status
from lidario.ros import Fleet, FleetScan, Publisher, Share, list_remote_lidars
from lidario.ros.names import DIAGNOSTICS, LASERSCAN, Node, gid_of
from lidario.scan import Scan
from tests.support.router import Router
from tests.test_model import FOUR

BOUND_S = 30.0
MODELS = {"rplidar": "rplidar-s2", "ydlidar": "ydlidar-4ros"}


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(BOUND_S):
        while not condition():
            await asyncio.sleep(0.002)


class Rig:
    """A simulated lidar that is open, and a list of its scans."""

    def __init__(self, stack: AsyncExitStack, router: Router) -> None:
        self.stack = stack
        self.router = router.address
        self.sent: list[Scan] = []

    async def open(self, family: str = "rplidar") -> lidario.Lidar:
        device = lidario.simulate(MODELS[family], spin_up=0)
        return await self.stack.enter_async_context(lidario.open_lidar(device))

    def run(self, publisher: Publisher | Share) -> None:
        """Publish all scans of its lidar in a task."""

        async def work() -> None:
            async with publisher.lidar.scans(depth=64) as stream:
                async for scan in stream:
                    self.sent.append(scan)
                    publisher.publish(scan)

        task = asyncio.create_task(work())

        async def end() -> None:
            task.cancel()
            await asyncio.wait([task])

        self.stack.push_async_callback(end)

    async def take(self, key: str, count: int) -> tuple[lidario.Lidar, list[Scan]]:
        """So many scans of ``zenoh:KEY``."""
        lidar = await self.stack.enter_async_context(lidario.open_lidar(f"zenoh:{key}?router={self.router}"))
        stream = await self.stack.enter_async_context(lidar.scans(depth=64))
        async with asyncio.timeout(BOUND_S):
            return lidar, [await anext(stream) for _ in range(count)]


@pytest.mark.parametrize(("family", "raw"), [("rplidar", False), ("ydlidar", True)])
async def test_scans_arrive_equal_and_info_and_health_with_them(router: Router, family: str, raw: bool) -> None:
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        lidar = await rig.open(family)
        key = f"equal/{family}/{raw}"
        share = await stack.enter_async_context(Share(lidar, key, raw=raw, router=router.address))
        rig.run(share)
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


async def test_a_topic_of_ros(router: Router) -> None:
    """Keys, tokens, payload, attachment and diagnostics, as a node would see them; ``zenoh:`` reads it, too."""
    store = get_typestore(Stores.ROS2_JAZZY)
    node = Node(domain=9)
    key, health = node.data_key("/front/scan", LASERSCAN), node.data_key("/diagnostics", DIAGNOSTICS)
    tokens: dict[str, bool] = {}
    messages: list[Sample] = []
    diagnostics: list[Any] = []
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        reader = await Bus.open(router.address)
        stack.push_async_callback(reader.close)
        reader.watch_tokens("@ros2_lv/9/**", tokens.__setitem__)
        reader.subscribe(key, messages.append)
        reader.subscribe(health, diagnostics.append)
        lidar = await rig.open()
        publisher = Publisher(
            lidar,
            topic="front/scan",
            frame_id="front",
            domain=9,
            router=router.address,
            robot="r7",
            preset="vendor",
        )
        async with publisher:
            assert publisher.key == key
            await until(lambda: len(tokens) == 3)
            zid = publisher._bus.id if publisher._bus else ""
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
    beams = len(rig.sent[0])
    for number, (scan, sample) in enumerate(zip(rig.sent, messages, strict=True), 1):
        assert sample.payload == scan.to_laserscan(beams, frame_id="front", preset="vendor").to_cdr()
        attachment = parse_attachment(sample.attachment)
        assert attachment is not None
        assert (attachment.number, attachment.gid) == (number, gid_of(scan_token))
        assert 0 < attachment.time_ns - scan.wall_stamp_ns < BOUND_S * 1e9
    (status,) = store.deserialize_cdr(diagnostics[-1].payload, "diagnostic_msgs/msg/DiagnosticArray").status  # type: ignore[attr-defined]
    assert (status.level, status.hardware_id, status.name) == (0, lidar.info.serial, "lidario: front/scan")
    assert (found.form, found.robot, found.model) == ("ros", "r7", lidar.info.model)
    assert found.health == lidar.health


async def test_the_grid_stays_until_the_speed_changes(router: Router) -> None:
    """slam_toolbox drops scans that have not as many beams as the first one."""
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        publisher = Publisher(await rig.open(), router=router.address)
        counts = [3200, 3195, 100, 3205, 2000, 2000, 2000, 2010, 3200]
        assert [publisher._grid(count) for count in counts] == [3200] * 6 + [2000] * 3
        assert [Publisher(publisher.lidar, beams=720)._grid(count) for count in counts] == [720] * 9


async def test_a_laserscan_of_somebody_elses_node_is_a_source(router: Router) -> None:
    key = f"0/urg/scan/{LASERSCAN.dds}/RIHS01_{'0' * 64}"
    laser = LaserScan(
        10**18, "laser", -1.0, 1.0, 0.5, 0.001, 0.1, 0.1, 8.0,
        np.array([1, 2, 3, 4, 5], np.float32), np.zeros(0, np.float32),
    )  # fmt: skip
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        node = await Bus.open(router.address)
        stack.push_async_callback(node.close)
        node.token(Node("urg").publisher_token(node.id, 7, "/urg/scan", LASERSCAN))
        sender = node.sender(key)

        async def publish() -> None:
            while True:
                sender.put(b"junk", b"")
                sender.put(laser.to_cdr(), b"")
                await asyncio.sleep(0.02)

        publishing = asyncio.create_task(publish())
        try:
            lidar, scans = await rig.take("0/urg/scan/*/*", 2)
        finally:
            publishing.cancel()
        assert scans[0].ranges.tolist() == [1, 2, 3, 4, 5]
        assert (lidar.info.family, lidar.info.serial) == ("ros2", "0/urg/scan")
        with pytest.raises(Unsupported, match="its publisher does not tell"):
            await lidar.get_sample_rate()
        found = [each for each in await list_remote_lidars(router.address) if "urg" in each.source]
        assert [(each.robot, each.model, each.health) for each in found] == [("/urg", "", None)]


async def test_many_lidars_are_one_fleet_or_have_to_be_named(router: Router) -> None:
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        fleet = await stack.enter_async_context(Fleet("many/*/scan", router=router.address, depth=4))
        shares = []
        for robot in ("a", "b"):
            share = Share(await rig.open(), f"many/{robot}/scan", router=router.address)
            shares.append(await stack.enter_async_context(share))
        with pytest.raises(
            ConnectFailed, match=r"2 lidars .* name one:\nzenoh:many/a/scan\nzenoh:many/b"
        ) as caught:
            await lidario.open_lidar(f"zenoh:many/*/scan?router={router.address}")
        assert caught.value.reason == "ambiguous"
        first, second = (share._outlet for share in shares)
        assert first is not None
        assert second is not None
        # The reader does nothing meanwhile. The busier lidar pushes out no scan of the other one.
        for number in range(6):
            if number == 3:
                first.sent += 2
            shares[0].publish(replace(FOUR, seq=number))
        shares[1].publish(FOUR)
        await until(lambda: len(fleet._scans) == 5)
        seen = [await anext(fleet) for _ in range(5)]
        assert [(each.scan.seq, each.lost) for each in seen if each.key == "many/a/scan"] == [
            (2, 2), (3, 2), (4, 0), (5, 0),
        ]  # fmt: skip
        assert {each.key for each in seen} == {"many/a/scan", "many/b/scan"}
        assert (fleet.lost, fleet.dropped, fleet.bad_messages) == (2, 2, 0)
        second.send(b"junk")
        await until(lambda: fleet.bad_messages)
        reading = asyncio.ensure_future(anext(fleet))
        await asyncio.sleep(0)
        await fleet.close()
        with pytest.raises(StopAsyncIteration):
            await reading


async def test_a_session_comes_back_when_the_robot_does(router: Router) -> None:
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        lidar = await rig.open()
        source = f"zenoh:back/scan?router={router.address}"
        async with Share(lidar, "back/scan", raw=True, router=router.address) as share:
            rig.run(share)
            await until(lambda: rig.sent)
            remote = await stack.enter_async_context(lidario.open_lidar(source, reconnect=True))
            scans = await stack.enter_async_context(remote.scans())
            first = await anext(scans)
        await until(lambda: not remote.is_connected)
        await stack.enter_async_context(Share(lidar, "back/scan", raw=True, router=router.address))
        async with asyncio.timeout(BOUND_S):
            assert (await anext(scans)).wall_stamp_ns > first.wall_stamp_ns
            while not remote.stats.reconnects:
                await anext(scans)


async def test_nobody_and_no_router(router: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.network.connect.WAIT_S", 0.05)
    with pytest.raises(ConnectFailed, match="no lidar is published under nothing/here") as caught:
        await lidario.open_lidar(f"zenoh:nothing/here?router={router.address}")
    assert caught.value.reason == "silent"
    with pytest.raises(ConnectFailed, match=r"no zenoh router responds at tcp/127\.0\.0\.1:1") as caught:
        await lidario.open_lidar("zenoh:nothing/here?router=tcp/127.0.0.1:1")
    assert caught.value.reason == "refused"
    with pytest.raises(InvalidValue, match="is not the address of a router"):
        await Bus.open("7447")


async def test_a_router_that_says_nothing_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.network.bus.OPEN_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as server:
        async with asyncio.timeout(BOUND_S):
            with pytest.raises(ConnectFailed, match="no zenoh router responds") as caught:
                await Bus.open(f"tcp/127.0.0.1:{server.getsockname()[1]}")
    assert caught.value.reason == "refused"


async def test_a_publisher_that_does_not_respond_is_not_waited_for(router: Router) -> None:
    """It takes the request and keeps it."""
    silent, asking = await Bus.open(router.address), await Bus.open(router.address)
    kept: list[Any] = []
    silent._session.declare_queryable("silent/key", kept.append)
    async with asyncio.timeout(BOUND_S):
        while not kept:
            assert await asking.query("silent/key", 0.05) == []
    for query in kept:
        query.drop()
    await silent.close()
    await asking.close()


async def test_a_configuration_of_zenoh_is_taken(
    router: Router, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ZENOH_CONFIG", str(tmp_path / "client.json5"))
    with pytest.raises(InvalidValue, match=r"or ZENOH_CONFIG=.* is no configuration of zenoh"):
        await Bus.open(router.address)
    (tmp_path / "client.json5").write_text('{id: "abc123", mode: "peer"}')
    bus = await Bus.open(router.address)
    assert bus.id == "abc123"
    await bus.close()


async def test_no_exception_of_zenoh_leaves(router: Router) -> None:
    bus = await Bus.open(router.address)
    for call in (
        bus.sender,
        bus.token,
        lambda key: bus.subscribe(key, print),
        lambda key: bus.watch_tokens(key, print),
    ):
        with pytest.raises(ConnectFailed, match=r"the zenoh session with .* failed"):
            call("a//b")
    with pytest.raises(ConnectFailed, match=r"the zenoh session with .* failed"):
        await bus.query("a//b", 1.0)
    await bus.close()
    await bus.close()
    with pytest.raises(ConnectFailed, match=r"the zenoh session with .* failed"):
        await bus.tokens("a", 1.0)


async def test_a_missing_package_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "zenoh", None)
    with pytest.raises(Unsupported, match=r"^zenoh needs .* pip install 'lidario-asyncio\[zenoh\]'$"):
        await lidario.open_lidar("zenoh:robots/r7/scan")


async def test_cancelling_an_opening_leaves_nothing(router: Router) -> None:
    opening = asyncio.ensure_future(lidario.open_lidar(f"zenoh:nothing/there?router={router.address}")._open())
    await asyncio.sleep(0.05)  # anywhere on the way: wherever that is, nothing may be left
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening


async def test_a_reader_may_come_before_the_first_scan(router: Router) -> None:
    """The publisher's lidar does not scan yet, so its mode is not known."""
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        share = await stack.enter_async_context(Share(await rig.open(), "early/scan", router=router.address))
        remote = await stack.enter_async_context(lidario.open_lidar(f"zenoh:early/scan?router={router.address}"))
        scans = await stack.enter_async_context(remote.scans())
        reading = asyncio.ensure_future(anext(scans))
        rig.run(share)
        async with asyncio.timeout(BOUND_S):
            assert (await reading).mode == "DenseBoost"


async def test_a_fleet_decodes_raw_bytes(router: Router) -> None:
    """Beside whole scans, of two families; a raw message that is lost is told."""
    async with AsyncExitStack() as stack:
        fleet = await stack.enter_async_context(Fleet("bytes/*/scan", router=router.address))
        sent: dict[str, dict[int, Scan]] = {}
        for name, family, raw in (("a", "rplidar", True), ("b", "ydlidar", True), ("c", "rplidar", False)):
            rig = Rig(stack, router)
            key = f"bytes/{name}/scan"
            share = Share(await rig.open(family), key, raw=raw, router=router.address)
            rig.run(await stack.enter_async_context(share))
            sent[key] = {}
            rig.sent = _ByTime(sent[key])  # type: ignore[assignment]
        got: dict[str, list[FleetScan]] = {key: [] for key in sent}
        async with asyncio.timeout(BOUND_S):
            while min(map(len, got.values())) < 4:
                each = await anext(fleet)
                got[each.key].append(each)
        for key, scans in got.items():
            for each in scans:
                at = round(each.scan.wall_stamp_ns, -5)
                await until(lambda key=key, at=at: at in sent[key])  # type: ignore[misc]
                before = sent[key][at]
                np.testing.assert_array_equal(each.scan.device_angles, before.device_angles)
                np.testing.assert_array_equal(each.scan.device_distances, before.device_distances)
                assert each.scan.mode == before.mode
                assert each.lost == 0
        assert (fleet.lost, fleet.bad_messages) == (0, 0)


class _ByTime:
    """Takes scans as a list does, and keeps them by their stamps."""

    def __init__(self, scans: dict[int, Scan]) -> None:
        self._scans = scans

    def append(self, scan: Scan) -> None:
        self._scans[round(scan.wall_stamp_ns, -5)] = scan


@pytest.mark.parametrize("form", ["scan", "ros"])
async def test_scans_that_were_lost_are_a_jump_in_the_numbers(router: Router, form: str) -> None:
    """They were dropped by zenoh, as it does where a line is busy."""
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        lidar = await rig.open()
        if form == "ros":
            publisher: Publisher | Share = Publisher(lidar, topic="lossy", router=router.address)
        else:
            publisher = Share(lidar, "lossy/scan", router=router.address)
        await stack.enter_async_context(publisher)
        source = f"zenoh:{publisher.key}?router={router.address}"
        remote = await stack.enter_async_context(lidario.open_lidar(source))
        scans = await stack.enter_async_context(remote.scans(depth=8))
        outlet = publisher._scans if isinstance(publisher, Publisher) else publisher._outlet
        assert outlet is not None
        reading = asyncio.ensure_future(anext(scans))
        while not reading.done():  # until its stream runs
            publisher.publish(replace(FOUR, seq=7))
            await asyncio.sleep(0.02)
        publisher.publish(replace(FOUR, seq=8))
        outlet.sent += 3
        publisher.publish(replace(FOUR, seq=12))
        async with asyncio.timeout(BOUND_S):
            last = (await reading).seq
            while (after := (await anext(scans)).seq) == last + 1:
                last = after
        assert after == last + 4
        assert remote.stats.missed_scans == 3


async def test_two_publishers_under_one_key(router: Router, caplog: pytest.LogCaptureFixture) -> None:
    """The second one is told, and a reader that is there goes on with the first one."""
    async with AsyncExitStack() as stack:
        rig, other = Rig(stack, router), Rig(stack, router)
        key = "rival/scan"
        share = await stack.enter_async_context(
            Share(await rig.open(), key, raw=True, router=router.address, robot="a")
        )
        rig.run(share)
        remote = await stack.enter_async_context(lidario.open_lidar(f"zenoh:{key}?router={router.address}"))
        scans = await stack.enter_async_context(remote.scans(depth=8))
        async with asyncio.timeout(BOUND_S):
            await anext(scans)
            # The reader may have come in the midst of a packet.
            skipped = remote.stats.skipped_bytes
            second = Share(await other.open("ydlidar"), key, raw=True, router=router.address, robot="b")
            other.run(await stack.enter_async_context(second))
            await until(lambda: len(other.sent) >= 3)
            for _ in range(4):
                assert (await anext(scans)).mode == "DenseBoost"
        assert remote.stats.skipped_bytes == skipped
        assert [text for text in caplog.messages if "the second one is ignored" in text]
        serial = second.lidar.info.serial
        told = f"YDLIDAR_4ROS {serial} of b is published under {key}, too: give each lidar a key of its own"
        await until(lambda: told in caplog.messages)
        with pytest.raises(
            ConnectFailed, match=r"two publishers send under zenoh:rival/scan \(a and b\): give each"
        ):
            await lidario.open_lidar(f"zenoh:{key}?router={router.address}")


async def test_a_reader_is_told_that_the_lidar_is_away(router: Router, caplog: pytest.LogCaptureFixture) -> None:
    """Its publisher is there, so the session goes on."""
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        share = await stack.enter_async_context(Share(await rig.open(), "away/scan", router=router.address))
        source = f"zenoh:away/scan?router={router.address}"
        remote = await stack.enter_async_context(lidario.open_lidar(source))
        status = share.status()
        assert share._status is not None
        away, back = (f"zenoh:away/scan: the lidar is {each} its publisher" for each in ("away from", "back at"))
        # Again and again: the publisher's side may not know of the reader yet.
        async with asyncio.timeout(BOUND_S):
            for lost, told in (("the lidar is away from its publisher", away), ("", back)):
                while told not in caplog.messages:
                    share._status.send(replace(status, lost=lost).to_bytes(whole=False))
                    await asyncio.sleep(0.02)
        assert caplog.messages.count(away) == 1
        assert remote.is_connected


async def test_a_publisher_that_sends_nothing_is_told(
    router: Router, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its process is there, so nothing is lost; it may hang, or its lidar may stand still."""
    monkeypatch.setattr("lidario.network.port.SILENCE_S", 0.05)
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        share = await stack.enter_async_context(Share(await rig.open(), "mute/scan", router=router.address))
        remote = await stack.enter_async_context(lidario.open_lidar(f"zenoh:mute/scan?router={router.address}"))
        scans = await stack.enter_async_context(remote.scans())
        reading = asyncio.ensure_future(anext(scans))
        said = "although its publisher is there. Does its lidar scan?"
        await until(lambda: any(said in text for text in caplog.messages))
        while not reading.done():
            share.publish(FOUR)
            await asyncio.sleep(0.01)
        assert len(await reading) == len(FOUR)


async def test_a_publisher_that_hangs_is_not_nobody(router: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.network.connect.WAIT_S", 0.05)
    bus = await Bus.open(router.address)
    bus.token(token_key(Token("hung/scan", "scan", "r9", "S2", "1")))
    with pytest.raises(
        ConnectFailed, match=r"zenoh:hung/scan is published by r9, which does not respond"
    ) as caught:
        await lidario.open_lidar(f"zenoh:hung/scan?router={router.address}")
    assert caught.value.reason == "silent"
    await bus.close()


@pytest.mark.parametrize("raw", [True, False])
async def test_noise_under_a_key_keeps_nobody_from_reading(router: Router, raw: bool) -> None:
    """Neither as messages nor as a status, before the first message of the publisher and after it."""
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        key = f"noise/{raw}"
        share = await stack.enter_async_context(Share(await rig.open(), key, raw=raw, router=router.address))
        noise = await Bus.open(router.address)
        stack.push_async_callback(noise.close)
        senders = [noise.sender(key), noise.sender(f"{key}/@lidario/status")]
        unwell = replace(share.status().about, health=Health(HealthStatus.ERROR, 1, "evil"), events=())
        evil = Status("raw", "evil", unwell).to_bytes(whole=True)

        async def disturb() -> None:
            while True:
                for sender in senders:
                    for payload in (b"", b"LDS1" + bytes(90), b"LDR1" + bytes(9), evil):
                        sender.put(payload, b"")
                        sender.put(payload, bytes(33))
                await asyncio.sleep(0.02)

        disturbing = asyncio.create_task(disturb())
        stack.callback(disturbing.cancel)
        rig.run(share)
        await until(lambda: rig.sent)
        remote = await stack.enter_async_context(lidario.open_lidar(f"zenoh:{key}?router={router.address}"))
        scans = await stack.enter_async_context(remote.scans(depth=8))
        async with asyncio.timeout(BOUND_S):
            for _ in range(3):
                assert (await anext(scans)).mode == "DenseBoost"
        assert await remote.get_health() == share.lidar.health
        assert remote.info == share.lidar.info


async def test_whole_scans_have_no_raw_bytes_to_pass_on(router: Router) -> None:
    """A relay that sends nothing would look like a lidar that stands still."""
    async with AsyncExitStack() as stack:
        rig = Rig(stack, router)
        rig.run(await stack.enter_async_context(Share(await rig.open(), "relayed/scan", router=router.address)))
        await until(lambda: rig.sent)
        source = f"zenoh:relayed/scan?router={router.address}"
        remote = await stack.enter_async_context(lidario.open_lidar(source))
        relay = await stack.enter_async_context(Share(remote, "relay/scan", raw=True, router=router.address))
        async with asyncio.timeout(BOUND_S):
            with pytest.raises(Unsupported, match="arrives as whole scans, so there are no raw bytes to publish"):
                await relay.run()
