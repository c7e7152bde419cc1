"""What goes wrong, and what the session makes of it: on the strict simulated devices, in driven time."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from lidario import (
    DeviceFault,
    DeviceLost,
    InternalError,
    ResponseTimeout,
    Scan,
    ScanStream,
    StreamFailed,
    open_lidar,
)
from lidario.revolution.seam import Seam
from tests.support.cable import cable_to
from tests.support.devices import Rig, left_still, make_rig, names, take
from tests.support.loop import DrivenLoop, driven, now, now_ns


async def until_it_fails(stream: ScanStream, why: str) -> None:
    """Take scans until the stream fails for that reason."""
    with pytest.raises(StreamFailed, match=why):
        while True:
            await anext(stream)


@driven
async def test_a_silent_device_ends_the_stream_but_not_the_session(rig: Rig) -> None:
    async with rig.open() as lidar:
        async with lidar.scans() as stream:
            await anext(stream)
            rig.device.mute = True
            before = now()
            await until_it_fails(stream, "no scan data")
            assert now() - before < 1.0 + rig.turn_s
        rig.device.mute = False
        assert len(await take(lidar, 1)) == 1
    assert left_still(rig)


@driven
async def test_a_stream_that_failed_leaves_the_device_still_at_once(rig: Rig) -> None:
    """Also where its reader goes on holding it, and before the session ends."""
    async with rig.open() as lidar:
        stream = lidar.scans()
        await anext(stream)
        clean = rig.device.transmit
        rig.device.transmit = lambda now: b"\0" * len(clean(now))
        await until_it_fails(stream, "only noise arrives")
        rig.device.transmit = clean
        await asyncio.sleep(0.2)
        assert left_still(rig)
        assert not lidar.is_scanning


@driven
async def test_a_session_that_was_ended_by_its_device_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    async with open_lidar("sim://rplidar-s2?via=memory&fault=unplug:1s") as lidar:
        with pytest.raises(DeviceLost):
            await asyncio.gather(*(read_on(lidar.scans()) for _ in range(2)))
        await asyncio.sleep(1.0)
    (told,) = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert told.startswith("the session ended: ")
    assert "unplugged" in told


async def read_on(stream: ScanStream) -> None:
    """Take scans as long as there are any."""
    async for _ in stream:
        pass


@driven
async def test_a_device_that_never_speeds_up_is_reported(rig: Rig) -> None:
    async with rig.open() as lidar:
        await lidar.get_modes()
        rig.device.spin_up_s = 1e6
        with pytest.raises(StreamFailed, match="no scan data"):
            await lidar.scan()
    assert left_still(rig)


@driven
async def test_garbage_for_an_answer_is_asked_again(rig: Rig) -> None:
    async with rig.open() as lidar:
        rig.device.garble_responses = 1
        assert (await lidar.get_info()) == lidar.info
        rig.device.garble_responses = 1000
        with pytest.raises(ResponseTimeout, match="no response to it") as caught:
            await lidar.get_info()
        assert caught.value.noise > 0
        assert isinstance(caught.value, TimeoutError)
        rig.device.garble_responses = 0
        assert (await lidar.get_info()) == lidar.info


@pytest.mark.parametrize(
    ("family", "model"),
    [
        ("rplidar", "rplidar-s2"),
        ("rplidar", "rplidar-s1"),  # silent for two seconds
        ("rplidar", "rplidar-old-firmware"),  # prints a banner
        ("ydlidar", "ydlidar-4ros"),
    ],
)
@driven
async def test_protection_stop_is_cured_by_a_reset(family: str, model: str) -> None:
    rig = make_rig(family, model)
    rig.device.protection_stop(0x21)
    async with rig.open() as lidar:
        assert lidar.health.ok
        assert "reset" in names(rig, obeyed=True)
        assert len(await take(lidar, 1)) == 1


@driven
async def test_a_fault_that_stays_is_raised_with_its_code(rig: Rig) -> None:
    rig.device.faults_cleared_by_reset = False
    rig.device.protection_stop(0x21)
    with pytest.raises(DeviceFault, match="33") as caught:
        async with rig.open():
            raise AssertionError("a faulty device was opened")
    assert caught.value.health.code == 0x21
    assert left_still(rig)


@pytest.mark.exhaustive("connects", sample=[200], full=[1000])
@driven
async def test_many_connects_to_a_device_that_still_streams(connects: int) -> None:
    random = np.random.default_rng(7)
    for round_number in range(connects):
        rig = make_rig("rplidar", seed=int(random.integers(1 << 30)))
        loop = asyncio.get_running_loop()
        assert isinstance(loop, DrivenLoop)
        leftover = int(random.integers(0, 4097))
        start = round(loop.time() * 1e9)
        rig.device.begin_streaming(1, start)
        # What the kernel still holds of a killed program's stream: up to 4 KiB, then the device goes on.
        loop.block(leftover / (rig.device.baudrate / 10))
        async with rig.open() as lidar:
            assert lidar.info.model.startswith("RPLIDAR S2"), round_number
        assert left_still(rig)


@pytest.mark.discards("the half of a request that a killed program has left")
@driven
async def test_half_a_request_left_behind_does_no_harm() -> None:
    for half in (b"\xa5", b"\xa5\x82", b"\xa5\x82\x05\x01", b"\xa5\x84\xff"):
        rig = make_rig("rplidar")
        rig.device.receive(half, now_ns())
        async with rig.open() as lidar:
            assert len(await take(lidar, 1)) == 1


@driven
async def test_an_unplugged_device_ends_every_stream_and_waiter() -> None:
    async with open_lidar("sim://rplidar-s2?via=memory&fault=unplug:3s") as lidar:
        streams = [lidar.scans() for _ in range(3)]
        for stream in streams:
            await anext(stream)

        async def until_lost(stream: object) -> None:
            with pytest.raises(DeviceLost, match="unplugged"):
                while True:
                    await anext(stream)  # type: ignore[call-overload]

        await asyncio.gather(*map(until_lost, streams))
        with pytest.raises(DeviceLost) as caught:
            await lidar.get_health()
        assert caught.value.__cause__ is not None


@pytest.mark.discards("a request too early is what it tests")
def test_rigs_are_strict() -> None:
    """The tests above mean something: the device they talk to refuses what comes too early."""
    rig: Rig = make_rig("rplidar")
    rig.device.begin_streaming(1, 0)
    rig.device.receive(b"\xa5\x25", 0)
    rig.device.receive(b"\xa5\x50", 9_000_000)
    assert names(rig, obeyed=False) == ["get_info"]


@driven
async def test_a_stream_that_turns_to_noise_ends_and_leaves_nothing_behind(rig: Rig) -> None:
    random = np.random.default_rng(3)
    async with rig.open() as lidar:
        async with lidar.scans() as stream:
            await anext(stream)
            clean = rig.device.transmit
            rig.device.transmit = lambda now: random.bytes(len(clean(now)))
            await until_it_fails(stream, "only noise arrives")
            assert lidar.stats.skipped_bytes > 10_000
            rig.device.transmit = clean
        assert len(await take(lidar, 1)) == 1
    assert left_still(rig)


@driven
async def test_a_rotor_that_stands_still_is_noticed(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    async with rig.read() as (_, stream):
        monkeypatch.setattr(Seam, "splits", lambda self, headings: [])
        await until_it_fails(stream, "no full revolution")
    assert left_still(rig)


@driven
async def test_a_mistake_of_ours_ends_the_stream_and_says_so(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:

    def blunder(seam: Seam, headings: object) -> list[Scan]:
        raise IndexError("a bug")

    async with rig.read() as (_, stream):
        monkeypatch.setattr(Seam, "splits", blunder)
        with pytest.raises(InternalError, match=r"IndexError\('a bug'\).*report") as caught:
            while True:
                await anext(stream)
        assert isinstance(caught.value.__cause__, InternalError)
        assert isinstance(caught.value.__cause__.__cause__, IndexError)
    assert left_still(rig)


@driven
async def test_a_device_that_does_not_come_back_from_a_reset(rig: Rig) -> None:
    async with rig.open() as lidar:
        async with lidar.scans() as stream:
            await anext(stream)
            rig.device.boot_s = 600.0
            with pytest.raises(ResponseTimeout, match="no response to"):
                await lidar.reset()
            await until_it_fails(stream, "could not be started again")
        assert not lidar.is_scanning


@driven
async def test_a_device_that_does_not_stop_is_reported(rig: Rig) -> None:
    async with rig.read() as (lidar, _):
        random = np.random.default_rng(1)
        rig.device.transmit = lambda now: random.bytes(64)
        rig.device.wakeup = lambda now: now + 5_000_000
        with pytest.raises(StreamFailed, match="bytes still arrive after 3 STOP requests"):
            await lidar.stop()


@driven
async def test_bytes_that_a_full_port_dropped_are_told(rig: Rig) -> None:
    with cable_to(rig) as cable:
        lidar = await rig.open()
    async with lidar, lidar.scans() as stream:
        await anext(stream)
        before = lidar.stats
        assert before.discarded_bytes == 0
        late = cable.ports[-1].late
        late.overflow_bytes = 5000
        await anext(stream)
        late.overflow_bytes = 5100
        await anext(stream)
        after = lidar.stats
    assert after.discarded_bytes == 5100
    ordinary = 3 * (before.bytes_received // max(before.scans, 1))
    assert 5100 < after.bytes_received - before.bytes_received < 5100 + ordinary


@driven
async def test_the_speed_that_a_device_reports_reaches_the_user() -> None:
    rig = make_rig("ydlidar")
    async with rig.open() as lidar:
        assert (await lidar.scan()).reported_rpm == 420.0
        await lidar.set_scan_frequency(10.3)
        scans = await take(lidar, 3)
        assert scans[-1].reported_rpm == pytest.approx(618.0)
        assert scans[-1].sorted().reported_rpm == scans[-1].reported_rpm
    silent = make_rig("rplidar")
    async with silent.open() as lidar:
        assert np.isnan((await lidar.scan()).reported_rpm)
