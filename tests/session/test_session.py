"""The session over both families, on the strict simulated devices, in driven time."""

import asyncio
import gc
import time
import weakref
from dataclasses import replace

import numpy as np
import pytest

from lidario import LocalProtocolError, SessionClosed, Stats, Unsupported
from tests.support.devices import SWITCHED, Rig, end_of, is_off, left_still, make_rig, names, scanning, some, take
from tests.support.loop import now, now_ns


async def test_stamps_are_one_turn_apart_and_in_the_past(rig: Rig) -> None:
    async with rig.open() as lidar:
        stamps = list[int]()
        async with lidar.scans() as stream:
            for _ in range(6):
                scan = await anext(stream)
                assert rig.turn_s < now() - scan.stamp_ns * 1e-9 < 1.2 * rig.turn_s
                assert abs(scan.wall_stamp_ns - scan.stamp_ns - (time.time_ns() - now_ns())) < 60e9
                stamps.append(scan.stamp_ns)
        assert np.diff(stamps) == pytest.approx(rig.turn_s * 1e9, rel=0.02)


async def test_every_question_has_an_answer_in_every_state(rig: Rig) -> None:
    async with rig.open() as lidar:
        for scanning in (False, True):
            if scanning:
                stream = lidar.scans()
                await anext(stream)
            assert (await lidar.get_info()) == lidar.info
            assert (await lidar.get_health()).ok
            assert any(mode.typical for mode in await lidar.get_modes())
            assert await lidar.get_scan_frequency() == pytest.approx(1 / rig.turn_s, rel=0.01)
            assert (told := await lidar.reset()).ok
            assert lidar.health is told
            if scanning:
                assert (await anext(stream)).seq > 0
                await lidar.stop()
                await end_of(stream, StopAsyncIteration)
                assert left_still(rig)


async def test_several_readers_each_get_every_scan(rig: Rig) -> None:
    async with rig.open() as lidar:
        one, two = await asyncio.gather(take(lidar, 4), take(lidar, 4))
        assert [scan.seq for scan in one] == [scan.seq for scan in two]
        assert names(rig).count("stop") <= 4


async def test_a_slow_reader_gets_the_latest_scan_and_the_count_of_the_missed(rig: Rig) -> None:
    async with rig.open() as lidar, lidar.scans() as slow, lidar.scans(depth=4) as deep, lidar.sectors() as parts:
        await anext(parts)
        first = await anext(slow)
        second = await anext(deep)
        await asyncio.sleep(10 * rig.turn_s)
        late = await anext(slow)
        assert late.dropped_before == late.seq - first.seq - 1 > 5
        kept = await some(deep, 4)
        assert [scan.seq for scan in kept] == list(range(kept[0].seq, kept[0].seq + 4))
        assert kept[0].dropped_before == kept[0].seq - second.seq - 1
        assert [scan.dropped_before for scan in kept[1:]] == [0, 0, 0]
        assert (await anext(parts)).dropped_before == parts.dropped > 70
        assert lidar.stats.dropped_scans == slow.dropped + deep.dropped


async def test_after_close_everything_says_so(rig: Rig) -> None:
    lidar = await rig.open()
    stream, unread = lidar.scans(), lidar.scans()
    await anext(stream)
    reading = asyncio.ensure_future(stream.__anext__())
    await asyncio.sleep(0)
    await lidar.close()
    assert left_still(rig)
    with pytest.raises(SessionClosed):
        await reading
    for called in (lidar.get_health, lidar.get_modes, lidar.stop, lidar.__aenter__):
        with pytest.raises(SessionClosed):
            await called()
    with pytest.raises(SessionClosed):
        lidar.tap(print)
    with pytest.raises(SessionClosed):
        lidar.record("never.mcap")
    for each in (unread, lidar.scans(), lidar.sectors(45)):
        with pytest.raises(SessionClosed, match="open_lidar"):
            await anext(each)
        with pytest.raises(SessionClosed):
            await each.__aenter__()
    for each in (stream, unread):
        await each.aclose()
    await lidar.close()


async def test_modes_by_name_and_id_and_not_two_at_a_time(rplidar: Rig) -> None:
    async with rplidar.open() as lidar:
        dense = await lidar.scan()
        assert dense.mode == "DenseBoost"
        assert dense.intensities is None
        standard = await lidar.scan("standard")
        assert standard.mode == "Standard"
        assert standard.intensities is not None
        assert len(dense) == pytest.approx(2 * len(standard), rel=0.02)
        async with scanning(lidar, standard.mode):
            with pytest.raises(LocalProtocolError, match="Standard"):
                await anext(lidar.scans("DenseBoost"))
            assert (await anext(lidar.scans())).mode == "Standard"
        # It lingers: who asks for no mode in particular goes on with it.
        before = lidar.stats.interruptions
        assert (await lidar.scan()).mode == "Standard"
        assert lidar.stats.interruptions == before
        async with scanning(lidar, "Standard", force=True):
            assert (await lidar.scan("Standard")).mode == "Standard"


@pytest.mark.parametrize("model", ["rplidar-s2", *SWITCHED])
@pytest.mark.parametrize("rests", [False, True])
async def test_a_motor_that_is_kept_spinning_goes_on_without_its_laser_until_it_is_told(
    model: str, rests: bool
) -> None:
    rig = make_rig(model)
    async with rig.open(keep_spinning=True) as lidar:
        await lidar.scan()
    assert (rig.device.scanning, rig.device.motor_on) == (False, True)
    async with rig.open(keep_spinning=True) as lidar:
        # Also where nobody reads behind the opening.
        await asyncio.sleep(2.0)
        assert rig.device.motor_on
        await lidar.scan()
        if rests:
            await lidar.stop()
        assert rig.device.motor_on
        await lidar.stop(motor=True)
        assert is_off(rig.device)
        await lidar.scan()
    assert not rig.device.motor_on


async def test_a_forced_scan_does_not_wait_for_the_rotor() -> None:
    waits = {}
    for force in (False, True):
        rig = make_rig("rplidar")
        rig.device.spin_up_s = 3.0
        async with rig.open() as lidar:
            await lidar.get_modes()
            before = now()
            async with lidar.scans("Standard", force=force) as stream:
                first = await anext(stream)
            waits[force] = now() - before
            assert ("force_scan" in names(rig, obeyed=True)) is force
            assert first.intensities is not None
            with pytest.raises(Unsupported, match="forced"):
                await anext(lidar.scans("DenseBoost", force=True))
    assert waits[True] < waits[False] - 1.0


async def test_every_byte_in_both_directions_is_counted_and_seen_by_taps(rig: Rig) -> None:
    """The ledger (`tests/support/ledger.py`) begins where bytes are parsed. Here the device itself counts."""
    sent, transmit = list[bytes](), rig.device.transmit
    seen: dict[str, bytearray] = {"in": bytearray(), "out": bytearray()}

    def send(now: int) -> bytes:
        sent.append(transmit(now))
        return sent[-1]

    def tap(direction: str, data: bytes, now: int) -> None:
        seen[direction] += data

    rig.device.transmit = send
    async with rig.open() as lidar:
        before = lidar.stats.bytes_received
        assert lidar.stats == Stats(bytes_received=before, response_bytes=before)
        lidar.tap(tap)
        async with scanning(lidar) as stream:
            await lidar.get_health()
            await some(stream, 2)
        await lidar.stop()
        assert lidar.stats.bytes_received == sum(map(len, sent)) == before + len(seen["in"]) > 20_000
        assert bytes(seen["out"]).endswith(b"\xa5\x25" if rig.family == "rplidar" else b"\xa5\x65")
        lidar.untap(tap)
        heard = len(seen["out"])
        await lidar.get_health()
        assert len(seen["out"]) == heard


async def test_the_sample_rate_and_what_there_is_not_before_a_stream_and_behind_it(rplidar: Rig) -> None:
    async with rplidar.open() as lidar:
        rate = await lidar.get_sample_rate()
        assert (rate.standard_us, rate.express_us) == (62, 31)
        assert "idle" in repr(lidar)
        told = [(lidar.mode, lidar.measured_scan_frequency)]
        async with lidar.scans("Standard") as stream:
            scan = await anext(stream)
            assert "scanning" in repr(lidar)
            told.append((lidar.mode, lidar.measured_scan_frequency))
        assert [*told, lidar.mode] == [(None, None), ((await lidar.get_modes())[0], scan.rpm / 60), None]
    assert "closed" in repr(lidar)


@pytest.mark.parametrize("rate", [10_000, 9000, 8000, 4000])
@pytest.mark.parametrize("rig", ["ydlidar-g4"], indirect=True)
async def test_a_sample_rate_that_the_device_does_not_tell_is_measured(rig: Rig, rate: int) -> None:
    rig.device.profile = replace(rig.device.profile, sample_ns=10**9 // rate)
    async with rig.open() as lidar:
        with pytest.raises(Unsupported, match="time_increment_ns"):
            await lidar.get_sample_rate()
        assert (await take(lidar, 4))[-1].time_increment_ns == pytest.approx(1e9 / rate, rel=0.001)


async def test_a_session_that_is_let_go_behind_a_stream_that_failed_is_left_still(rig: Rig) -> None:
    lidar = await rig.open()
    stream = lidar.scans()
    await anext(stream)
    rig.device.mute = True
    await end_of(stream)
    rig.device.mute = False
    other = lidar.scans()
    await anext(other)
    gone = weakref.ref(lidar)
    del stream, other, lidar
    gc.collect()
    assert gone() is None
    await asyncio.sleep(2.0)
