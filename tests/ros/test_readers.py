"""What a reader is told through a router: loss, a second publisher, a lidar or a publisher that is away, noise."""

import asyncio
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from mcap.reader import make_reader

import lidario
from lidario.basics.model import Health, HealthStatus
from lidario.errors import CannotRecord, ConnectFailed, Unsupported
from lidario.network.bus import Bus
from lidario.network.status import Status
from lidario.ros import Publisher, Share
from tests.scans.test_scan import FOUR
from tests.support.loop import until
from tests.support.network import BOUND_S, Rig, publish_in_vain, publisher_of
from tests.support.recorded import assert_same_scans
from tests.support.router import Router

pytestmark = pytest.mark.long
DESCRIPTOR = b"\xa5\x5a"
"""How each descriptor of a stream begins (vendor's manual, response descriptor)."""


async def publish_on(publisher: Publisher | Share) -> None:
    """Publish scans until this is cancelled."""
    while True:
        publisher.publish(FOUR)
        await asyncio.sleep(0.02)


async def test_a_recording_goes_on_when_the_robot_is_back(router: Router, tmp_path: Path) -> None:
    taken = list[lidario.Scan]()
    async with Rig(router) as rig:
        lidar = await rig.open()
        async with Share(lidar, "kept/scan", raw=True, router=router.address) as share:
            rig.run(share)
            await until(lambda: rig.sent)
            remote, scans = await rig.read("kept/scan", reconnect=True)
            recording = await rig.enter_async_context(remote.record(tmp_path / "run.mcap", split_s=1.0))
            taken += [await anext(scans) for _ in range(6)]
        await until(lambda: not remote.is_connected)
        await rig.share("kept/scan", raw=True, lidar=lidar)
        async with asyncio.timeout(BOUND_S):
            while not remote.stats.reconnects or len(taken) < 18:
                taken.append(await anext(scans))
        await recording.close()
        assert recording.error is None
        assert recording.files > 1
    assert lidario.summarize(recording.source).losses == 1
    assert_same_scans(taken, list(lidario.decode_file(recording.source)))


@pytest.mark.parametrize("reconnect", [False, True])
async def test_a_session_ends_when_the_line_that_was_lost_is_closed_too(
    router: Router, reconnect: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No task is left at the end of a test, although zenoh takes a while to close."""
    monkeypatch.setattr("lidario.network.port.GONE_S", 0.05)
    close = Bus.close

    async def close_late(bus: Bus) -> None:
        await asyncio.sleep(0.3)
        await close(bus)

    monkeypatch.setattr(Bus, "close", close_late)
    async with Rig(router) as rig:
        lidar = await rig.open()
        async with Share(lidar, "late/scan", raw=True, router=router.address) as share:
            rig.run(share)
            await until(lambda: rig.sent)
            remote, scans = await rig.read("late/scan", reconnect=reconnect)
            await anext(scans)
        await until(lambda: not remote.is_connected)


@pytest.mark.parametrize("sought_in_vain", [False, True])
async def test_what_passes_while_a_publisher_is_away_is_counted_as_missed(
    router: Router, sought_in_vain: bool, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """And scans come again when it is back."""
    monkeypatch.setattr("lidario.network.port.GONE_S", 0.05)
    if sought_in_vain:
        monkeypatch.setattr("lidario.network.connect.WAIT_S", 0.05)
    async with Rig(router) as rig:
        lidar = await rig.open()
        async with Share(lidar, "gone/scan", router=router.address) as share:
            rig.run(share)
            remote, scans = await rig.read("gone/scan", reconnect=True)
            taken = [await anext(scans)]
        if sought_in_vain:
            await until(lambda: "no lidar is published under gone/scan" in caplog.text)
        await until(lambda: not remote.is_connected)
        rig.run(await rig.share("gone/scan", lidar=lidar))
        await until(lambda: remote.stats.reconnects)
        back_ns = time.monotonic_ns()
        async with asyncio.timeout(BOUND_S):
            while taken[-1].stamp_ns < back_ns:
                taken.append(await anext(scans))
        missed = sum(after.seq - before.seq - 1 for before, after in pairwise(taken))
        assert 0 < missed <= remote.stats.missed_scans


async def test_a_recording_holds_the_descriptor_that_was_made_for_the_stream(router: Router) -> None:
    """Places in it are counted in received bytes: without it each stream would lack its first bytes."""
    shown = list[bytes]()
    async with Rig(router) as rig:
        rig.run(await rig.share("shown/scan", raw=True))
        await until(lambda: rig.sent)
        remote, scans = await rig.read("shown/scan")
        remote.tap(lambda direction, data, now: shown.append(data) if direction == "in" else None)
        await anext(scans)
    assert shown[0].startswith(DESCRIPTOR)


async def test_a_publisher_that_is_waited_for_is_known(router: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first scan tells nothing of its lidar."""
    monkeypatch.setattr("lidario.network.connect.ASK_AGAIN_S", BOUND_S)
    async with Rig(router) as rig:
        lidar, waited_for = await rig.open(), asyncio.Event()
        bus = await rig.bus()
        bus.watch_readers(bus.sender("meanwhile/scan", bytes(16)), lambda _: waited_for.set())
        reading = asyncio.ensure_future(rig.read("meanwhile/scan"))
        async with asyncio.timeout(BOUND_S):
            await waited_for.wait()
            share = await rig.share("meanwhile/scan", lidar=lidar)
            rig.work(publish_on(share))
            remote, _ = await reading
        assert remote.info == lidar.info
        assert await remote.get_health() == lidar.health


async def test_what_was_read_at_once_is_dated_as_one_read(router: Router) -> None:
    """In pieces, the revolutions of the first one seem to have come as late as the last byte did."""
    async with Rig(router) as rig:
        rig.run(await rig.share("at-once/scan", raw=True))
        await until(lambda: rig.sent)
        _, scans = await rig.read("at-once/scan")
        async with asyncio.timeout(BOUND_S):
            found = [await anext(scans) for _ in range(2)]
            time.sleep(0.5)  # noqa: ASYNC251 - one read then holds 17 kB
            found += [await anext(scans) for _ in range(6)]
    assert {scan.wall_stamp_ns for scan in found} <= {scan.wall_stamp_ns for scan in rig.sent}


@pytest.mark.parametrize("form", ["scan", "ros"])
async def test_scans_that_were_lost_are_a_jump_in_the_numbers(router: Router, form: str) -> None:
    """They were dropped by zenoh, as it does where a line is busy."""
    async with Rig(router) as rig:
        publisher = publisher_of(await rig.open(), form, "lossy/scan", rig.router)
        await rig.enter_async_context(publisher)
        remote, scans = await rig.read(publisher.key)
        seq = None
        missed = 0
        async with asyncio.timeout(BOUND_S), asyncio.TaskGroup() as tasks:
            # On a busy machine zenoh drops some by itself: there are always more.
            going_on = tasks.create_task(publish_on(publisher))
            while missed < 3:
                scan = await anext(scans)
                if seq is None:
                    for _ in range(3):
                        publish_in_vain(publisher, FOUR)
                else:
                    missed += scan.seq - seq - 1
                seq = scan.seq
            going_on.cancel()
        assert remote.stats.missed_scans == missed


async def test_two_publishers_under_one_key(router: Router, caplog: pytest.LogCaptureFixture) -> None:
    """The second one is told, and a reader that is there goes on with the first one."""
    async with Rig(router) as rig, Rig(router) as other:
        key = "rival/scan"
        share = await rig.enter_async_context(
            Share(await rig.open(), key, raw=True, router=router.address, robot="a")
        )
        rig.run(share)
        remote, scans = await rig.read(key)
        async with asyncio.timeout(BOUND_S):
            await anext(scans)
            # The reader may have come in the midst of a packet.
            skipped = remote.stats.skipped_bytes
            second = Share(await other.open("ydlidar"), key, raw=True, router=router.address, robot="b")
            other.run(await other.enter_async_context(second))
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


async def test_a_reader_is_told_that_the_lidar_is_away(
    router: Router, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its publisher is there, so the session goes on."""
    monkeypatch.setattr("lidario.ros.broadcast.STATUS_S", 0.02)
    async with Rig(router) as rig:
        share = await rig.share("away/scan")
        remote = await rig.remote("away/scan")
        status = share.status()
        away, back = (f"zenoh:away/scan: the lidar is {each} its publisher" for each in ("away from", "back at"))
        for lost, told in (("the lidar is away from its publisher", away), ("", back)):
            monkeypatch.setattr(share, "status", lambda lost=lost: replace(status, lost=lost))
            await until(lambda told=told: told in caplog.messages)  # type: ignore[misc]
        assert caplog.messages.count(away) == 1
        assert remote.is_connected


async def test_a_publisher_that_sends_nothing_is_told(
    router: Router, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its process is there, so nothing is lost; it may hang, or its lidar may stand still."""
    # Within this time it must be seen that the publisher is there.
    monkeypatch.setattr("lidario.network.port.SILENCE_S", 2.0)
    async with Rig(router) as rig:
        share = await rig.share("mute/scan")
        _, scans = await rig.read("mute/scan")
        reading = asyncio.ensure_future(anext(scans))
        said = "although its publisher is there. Does its lidar scan?"
        await until(lambda: any(said in text for text in caplog.messages))
        while not reading.done():
            share.publish(FOUR)
            await asyncio.sleep(0.01)
        assert len(await reading) == len(FOUR)


@pytest.mark.parametrize("raw", [True, False])
async def test_noise_under_a_key_keeps_nobody_from_reading(router: Router, raw: bool) -> None:
    """Neither as messages nor as a status, before the first message of the publisher and after it."""
    async with Rig(router) as rig:
        key = f"noise/{raw}"
        share = await rig.share(key, raw=raw)
        noise = await rig.bus()
        senders = [noise.sender(each, bytes(16)) for each in (key, f"{key}/@lidario/status")]
        unwell = replace(share.status().about, health=Health(HealthStatus.ERROR, 1, "evil"), events=())
        evil = Status("raw", "evil", unwell).to_bytes(whole=True)

        async def disturb() -> None:
            while True:
                for sender in senders:
                    for payload in (b"", b"LDS1" + bytes(90), b"LDR1" + bytes(9), evil):
                        sender.publisher.put(payload)
                        sender.publisher.put(payload, attachment=bytes(33))
                await asyncio.sleep(0.02)

        rig.work(disturb())
        rig.run(share)
        await until(lambda: rig.sent)
        remote, scans = await rig.read(key)
        async with asyncio.timeout(BOUND_S):
            for _ in range(3):
                assert (await anext(scans)).mode == "DenseBoost"
        assert await remote.get_health() == share.lidar.health
        assert remote.info == share.lidar.info


async def test_whole_scans_have_no_raw_bytes_to_pass_on(router: Router) -> None:
    """A relay that sends nothing would look like a lidar that stands still."""
    async with Rig(router) as rig:
        rig.run(await rig.share("relayed/scan"))
        await until(lambda: rig.sent)
        remote = await rig.remote("relayed/scan")
        with pytest.raises(Unsupported, match="arrives as whole scans, so there are no raw bytes to publish"):
            Share(remote, "relay/scan", raw=True, router=router.address)


@pytest.mark.parametrize("form", ["scan", "ros", "raw"])
async def test_a_recording_of_scans_keeps_some_or_does_not_begin(router: Router, form: str, tmp_path: Path) -> None:
    async with Rig(router) as rig:
        publisher = publisher_of(await rig.open(), form, "some/scan", rig.router)
        rig.run(await rig.enter_async_context(publisher))
        await until(lambda: rig.sent)
        remote = await rig.remote(publisher.key)
        bare, with_scans = tmp_path / "bare.mcap", tmp_path / "scans.mcap"
        if form != "raw":
            with pytest.raises(CannotRecord, match=r"record with --scans \(scans=True\)"):
                await remote.record(bare).start()
            assert not bare.exists()
        async with remote.record(with_scans, scans=True), remote.scans() as scans, asyncio.timeout(BOUND_S):
            for _ in range(3):
                await anext(scans)
    with with_scans.open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert topics.count("/scan") >= 3
