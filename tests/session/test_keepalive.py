"""Power-down protection: what must be repeated is repeated, whatever the program does, and ends with the stream."""

import asyncio
import time
from itertools import pairwise

import pytest

from lidario import Lidar, open_lidar
from lidario.port.port import Port
from lidario.sim.serve import TcpServer
from tests.support.devices import Rig, names, scanning, some, take
from tests.support.loop import driven_loop, now, now_ns
from tests.support.ports import PATIENCE_S, on_both_loops
from tests.support.times import begun

MINUTE_S = 60.0
INTERVAL_S = 0.4
LIMIT_S = 3.0
"""The device's patience (4ROS development manual, power-down protection)."""


def pauses(rig: Rig) -> list[float]:
    """Seconds between the scan requests the device has heard."""
    heard = [each.at_ns for each in rig.device.log if each.data == b"\xa5\x60"]
    return [(later - earlier) * 1e-9 for earlier, later in pairwise(heard)]


async def scan_for(lidar: Lidar, seconds: float) -> int:
    end, count = now() + seconds, 0
    async with lidar.scans(depth=64) as stream:
        while now() <= end:
            await anext(stream)
            count += 1
    return count


@pytest.mark.long
@pytest.mark.exhaustive("minutes", sample=[2], full=[10])
async def test_many_minutes_with_protection_on(ydlidar: Rig, minutes: int) -> None:
    seconds = minutes * MINUTE_S
    async with ydlidar.open() as lidar:
        assert await lidar.set_power_down_protection(True) is True
        count = await scan_for(lidar, seconds)
        assert count == pytest.approx(seconds / ydlidar.turn_s, rel=0.001)
        assert lidar.stats.keepalives == pytest.approx(seconds / INTERVAL_S, rel=0.001, abs=1)
        assert lidar.stats.interruptions == lidar.stats.skipped_bytes == lidar.stats.lost_packets == 0


@pytest.mark.long
async def test_a_program_that_blocks_the_loop_does_not_stop_the_device_in_any_phase(ydlidar: Rig) -> None:
    """For 2.5 s, beginning 0 to 0.95 s after a keepalive; without a thread."""
    loop = driven_loop()
    async with ydlidar.open() as lidar:
        await lidar.set_power_down_protection(True)
        async with lidar.scans(depth=64) as stream:
            for phase in range(20):
                await anext(stream)
                sent = lidar.stats.keepalives
                while lidar.stats.keepalives == sent:
                    await asyncio.sleep(0.001)
                await asyncio.sleep(phase / 20)
                loop.block(2.5)
        assert 2.5 + 0.8 * INTERVAL_S < max(pauses(ydlidar)) < LIMIT_S
        assert ydlidar.device.lapses == lidar.stats.restarts == lidar.stats.interruptions == 0


@pytest.mark.long
async def test_after_a_lapse_the_next_keepalive_starts_the_device_again(ydlidar: Rig) -> None:
    loop = driven_loop()
    async with ydlidar.open() as lidar:
        await lidar.set_power_down_protection(True)
        async with scanning(lidar) as stream:
            loop.block(4.0)
            await some(stream, 50)
        assert (ydlidar.device.lapses, lidar.stats.restarts) == (1, 0)


@pytest.mark.long
async def test_protection_that_an_earlier_program_left_on_is_learned(ydlidar: Rig) -> None:
    ydlidar.device.protected = True
    async with ydlidar.open() as lidar:
        await scan_for(lidar, 20.0)
        assert (ydlidar.device.lapses, lidar.stats.restarts) == (1, 1)
        await scan_for(lidar, 20.0)
        assert (ydlidar.device.lapses, lidar.stats.restarts) == (1, 1)
    assert ydlidar.device.protected


@pytest.mark.long
async def test_protection_is_not_toggled_unless_a_stream_ends_as_if_it_were_on(ydlidar: Rig) -> None:
    async with ydlidar.open() as lidar:
        async with lidar.scans() as stream:
            await some(stream, 10)
            ydlidar.device.halt(now_ns())
            await some(stream, 40)
        assert lidar.stats.restarts == 1
        assert "toggle_protection" not in names(ydlidar)
        assert lidar.stats.keepalives == 0
        await scan_for(lidar, 2.9)
        async with lidar.scans() as stream:
            began = now()
            while now() - began < 3.0:
                await anext(stream)
            ydlidar.device.halt(now_ns())
            await some(stream, 40)
    assert names(ydlidar).count("toggle_protection") == 2
    assert not ydlidar.device.protected
    assert lidar.stats.keepalives == 0


@pytest.mark.long
@pytest.mark.parametrize("wanted", [True, False])
async def test_a_reset_keeps_what_the_program_has_set(ydlidar: Rig, wanted: bool) -> None:
    async with ydlidar.open() as lidar:
        await lidar.set_power_down_protection(wanted)
        await lidar.set_scan_frequency(9.0)
        await lidar.reset()
        scans = await take(lidar, 60)
        assert scans[-1].rpm == pytest.approx(540, rel=0.01)
        assert ydlidar.device.protected is wanted
        assert bool(lidar.stats.keepalives) is wanted
        assert ydlidar.device.lapses == 0
        toggled = names(ydlidar).count("toggle_protection")
        await take(lidar, 2)
        assert names(ydlidar).count("toggle_protection") == toggled


async def test_no_thread_writes_behind_the_stop_requests(ydlidar: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[bytes] = []
    write = Port.write

    def see(port: Port, data: bytes) -> None:
        told.append(data)
        write(port, data)

    async with ydlidar.open() as lidar:
        await lidar.set_power_down_protection(True)
        monkeypatch.setattr(Port, "set_repeat", lambda _, request, *interval: told.append(request or b"no more"))
        monkeypatch.setattr(Port, "write", see)
        async with scanning(lidar):
            told.clear()
        assert told[:2] == [b"no more", b"\xa5\x00"]


@pytest.mark.long
async def test_it_ends_with_the_stream_and_with_the_protection(ydlidar: Rig) -> None:
    async with ydlidar.open() as lidar:
        await lidar.set_power_down_protection(True)
        await scan_for(lidar, 5.0)
        sent = lidar.stats.keepalives
        await asyncio.sleep(0.2)  # until the stop requests are written
        heard = len(ydlidar.device.log)
        await asyncio.sleep(10.0)
        assert lidar.stats.keepalives == sent >= 4
        assert len(ydlidar.device.log) == heard
        assert await lidar.set_power_down_protection(False) is False
        await scan_for(lidar, 5.0)
        assert lidar.stats.keepalives == sent


async def test_protection_switched_while_scanning(ydlidar: Rig) -> None:
    async with ydlidar.read() as (lidar, stream):
        for wanted in (True, True, False, False, True):
            assert await lidar.set_power_down_protection(wanted) is wanted
            await anext(stream)
        before = lidar.stats.keepalives
        await some(stream, 40)
        assert lidar.stats.keepalives > before


async def test_zero_offset_is_told_and_applied_only_when_asked(ydlidar: Rig) -> None:
    ydlidar.device.zero_offset = -50
    async with ydlidar.open() as lidar:
        assert await lidar.get_zero_offset() == -12.5
        before = await lidar.scan()
        await lidar.set_zero_offset(True)
        after = await lidar.scan()
        await lidar.set_zero_offset(False)
        again = await lidar.scan()
    shift = (after.device_angles[0] - before.device_angles[0]) % 360
    assert shift == pytest.approx(347.5, abs=0.5)
    assert again.device_angles[0] == pytest.approx(before.device_angles[0], abs=0.5)


@pytest.mark.long
@pytest.mark.parametrize("steps", range(1, 40, 6))
@pytest.mark.parametrize("on", [True, False])
async def test_an_unconfirmed_toggle_is_checked_before_the_next_stream(ydlidar: Rig, on: bool, steps: int) -> None:
    """Without protection nothing is sent in mid-scan; with it, what keeps the device going."""
    async with ydlidar.open() as lidar:
        await lidar.set_power_down_protection(not on)
        async with scanning(lidar) as stream:
            setting = await begun(lidar.set_power_down_protection(on), steps)
            setting.cancel()
            await asyncio.wait([setting])
            before = names(ydlidar).count("scan")
            await some(stream, 35)
        kept = names(ydlidar).count("scan") - before
        assert (kept > 10) is ydlidar.device.protected, (kept, ydlidar.device.protected)
        assert ydlidar.device.lapses == 0


@pytest.mark.long
async def test_a_toggle_whose_response_was_lost_is_looked_at(ydlidar: Rig) -> None:
    async with ydlidar.open() as lidar:
        await lidar.set_power_down_protection(True)
        ydlidar.device.response_delay_s = 0.3
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.1):
                await lidar.set_power_down_protection(False)
        assert not ydlidar.device.protected
        ydlidar.device.response_delay_s = 0.0005
        before = lidar.stats.keepalives
        await scan_for(lidar, 20.0)
        assert lidar.stats.keepalives == before
        assert not ydlidar.device.protected
        assert ydlidar.device.lapses == 0


LONGEST_BLOCK_S = 20.0


@pytest.mark.long
@pytest.mark.real_time
@on_both_loops
async def test_the_thread_writes_what_the_loop_does_not(ydlidar: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop is blocked until the device has heard what keeps it going three times."""
    monkeypatch.setattr("lidario.families.ydlidar.device.KEEPALIVE_S", 0.1)
    # A busy machine may let the thread stand for longer than a real device waits.
    monkeypatch.setattr("lidario.families.ydlidar.simulated.device._ALIVE_FOR", round(PATIENCE_S * 1e9))
    written: list[bytes] = []
    with TcpServer(ydlidar.device) as server:
        address = "tcp://{}:{}?family=ydlidar".format(*server.address)
        async with asyncio.timeout(3 * PATIENCE_S), open_lidar(address) as lidar:
            await lidar.set_power_down_protection(True)
            async with scanning(lidar):
                lidar.tap(lambda way, data, at: written.append(data) if way == "out" else None)
                # One may be under way that was written before.
                heard, began = names(ydlidar).count("scan") + 1, time.monotonic()
                while names(ydlidar).count("scan") < heard + 3 and time.monotonic() - began < LONGEST_BLOCK_S:
                    time.sleep(0.01)  # noqa: ASYNC251 - that is what blocks the loop
                assert names(ydlidar).count("scan") >= heard + 3
                assert ydlidar.device.scanning
                # The device may hear a request before the thread has counted it.
                while lidar.stats.keepalives < 3:
                    await asyncio.sleep(0.01)
            while ydlidar.device.scanning:
                await asyncio.sleep(0.01)
            heard = len(names(ydlidar))
            await asyncio.sleep(0.2)
            assert "scan" not in names(ydlidar)[heard:], "behind the stop requests it was written again"
        assert ydlidar.device.lapses == 0
        assert written.count(b"\xa5\x60") >= 3
