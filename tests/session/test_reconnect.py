"""A session with `reconnect` finds its device again and goes on: in driven time."""

import asyncio
import math
from collections.abc import Callable
from typing import Any

import pytest

from lidario import open_lidar
from lidario.port.port import Port
from lidario.port.simulated import MemoryTransport
from lidario.sim.memory import MemoryLine
from tests.support.cable import cable_to, next_after, on_a_cable
from tests.support.devices import Rig, both_families, is_off, left_still, make_rig, names, scanning, some
from tests.support.ledger import assert_stats_close
from tests.support.loop import at_each, driven_loop, now, now_ns, run_driven

PROMISE_S = 2.0
"""Longest time from the moment at which the device responds again to the next scan."""
MODES = {"rplidar": "Standard", "ydlidar": None}
"""Slow ones, which are cheap to simulate."""


async def test_it_goes_on_after_the_cable_was_pulled_out(rig: Rig) -> None:
    seen = list[str]()

    def tap(direction: str, data: bytes, now: int) -> None:
        seen.append(direction)

    async with on_a_cable(rig) as (cable, lidar):
        lidar.tap(tap)
        async with lidar.scans(MODES[rig.family]) as stream:
            last = (await some(stream, 3))[-1]
            cable.pull()
            seen.clear()
            pulled = now()
            await asyncio.sleep(3.0)
            assert (lidar.is_connected, lidar.is_scanning, lidar.stats.reconnects) == (False, True, 0)
            cable.plug()
            responds = now() + rig.device.boot_s
            first = await next_after(stream, pulled)
            assert now() <= responds + PROMISE_S
            assert {"in", "out"} <= set(seen)
            lidar.untap(tap)
            seen.clear()
            second = await anext(stream)
            assert not seen
            assert (lidar.is_connected, lidar.stats.reconnects) == (True, 1)
            assert_stats_close(lidar.stats)
        assert first.mode == last.mode
        assert math.isclose(first.rpm, last.rpm, rel_tol=0.05)
        # The gap can be seen: the number jumps by as many revolutions as the rotor would have made.
        gap_s = (first.stamp_ns - last.stamp_ns) * 1e-9
        assert abs(first.seq - last.seq - gap_s / rig.turn_s) <= 2
        assert second.seq == first.seq + 1
        assert lidar.stats.reconnects == 1
        # A scan may have been dropped while the test slept.
        assert lidar.stats.missed_scans >= first.seq - last.seq - 2
        assert lidar.stats.scans + lidar.stats.missed_scans > second.seq


async def test_the_stream_of_the_old_line_is_watched_no_more(rig: Rig) -> None:
    """It is silent for ever, while that of the new line goes on."""
    async with on_a_cable(rig) as (cable, lidar), scanning(lidar) as stream:
        await some(stream, 3)
        cable.pull()
        pulled = now()
        cable.plug(boots=False)
        await next_after(stream, pulled)
        assert now() - pulled < 0.5
        rig.device.log.clear()
        await asyncio.sleep(3.0)
        assert (names(rig), lidar.stats.restarts, lidar.stats.reconnects) == ([], 0, 1)


@pytest.mark.parametrize("baudrate", [1_000_000, 1_500_000])
async def test_it_is_found_at_the_speed_of_now_and_before(baudrate: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """No document says whether a loss of power sets it back; that of this one does, and a loose plug does not."""
    rig, lines = make_rig("rplidar"), list[MemoryTransport]()

    async def open_serial(path: str, baudrate: int) -> Port:
        port = Port(path, baudrate)
        line = MemoryTransport(asyncio.get_running_loop(), port, MemoryLine(rig.device))
        line.set_baudrate(baudrate)
        port.connection_made(line)
        lines.append(line)
        return port

    monkeypatch.setattr("lidario.session.finding.connect.open_serial", open_serial)
    async with open_lidar("line", family="rplidar", reconnect=True) as lidar, scanning(lidar, "Standard") as stream:
        await lidar.set_baudrate(1_500_000)
        assert (await anext(stream)).lost_packets == 0
        assert lidar.baudrate == rig.device.baudrate == 1_500_000
        if baudrate == 1_000_000:
            restarts(rig.device)
        else:
            lines[-1].end(OSError("the line was unplugged"))
        await next_after(stream, now() + rig.device.boot_s)
        assert lidar.baudrate == rig.device.baudrate == baudrate
        assert lidar.stats.reconnects == 1
    assert left_still(rig)


def restarts(device: Any) -> None:
    device.reboot(now_ns())


def protects_itself(device: Any) -> None:
    device.protection_stop(0x8001)


def freezes_and_is_switched_off(device: Any) -> None:
    device.freeze(now_ns())
    asyncio.get_running_loop().call_later(4.0, lambda: device.reboot(now_ns()))


def is_mute_for_a_while(device: Any) -> None:
    device.mute = True
    asyncio.get_running_loop().call_later(4.0, lambda: setattr(device, "mute", False))


@pytest.mark.parametrize(
    ("trouble", "responds_s"),
    [
        (restarts, 1.0),
        (protects_itself, 0.0),
        pytest.param(
            freezes_and_is_switched_off,
            5.0,
            marks=pytest.mark.discards("a frozen device hears nothing, and gives no sign of it"),
        ),
        (is_mute_for_a_while, 4.0),
    ],
)
async def test_it_goes_on_after(rig: Rig, trouble: Callable[[Any], None], responds_s: float) -> None:
    async with rig.open(reconnect=True) as lidar:
        async with lidar.scans() as stream:
            last = await anext(stream)
            trouble(rig.device)
            began = now()
            first = await next_after(stream, began + 0.5)
            # Silence is noticed after 0.9 s; a Protection Stop is cured by a reset, which boots for 1 s.
            silence_s = 0.9 if responds_s < 1 else 0.0
            boot_s = rig.device.boot_s if trouble is protects_itself else 0.0
            assert now() <= began + responds_s + silence_s + boot_s + PROMISE_S
            assert first.seq > last.seq + 5
        # By its old line where it still responds, else by a new one.
        assert lidar.stats.reconnects + lidar.stats.restarts == 1
        assert lidar.health.ok


@pytest.mark.long
async def test_a_setting_is_made_again() -> None:
    async with on_a_cable("ydlidar") as (cable, lidar):
        cable.rig.device.zero_offset = 40
        await lidar.set_power_down_protection(True)
        await lidar.set_scan_frequency(9.0)
        await lidar.set_zero_offset(True)
        async with lidar.scans() as stream:
            before = await anext(stream)
            cable.pull()
            cable.plug()
            pulled = now()
            cable.rig.device.zero_offset = 80
            after = await next_after(stream, pulled)
            assert math.isclose(after.rpm, 540, rel_tol=0.03)
            assert after.seam != before.seam
            # Without the keepalives it would stop by itself after three seconds.
            await next_after(stream, now() + 5.0)
            assert lidar.stats.keepalives >= 4
        assert lidar.stats.reconnects == 1


async def test_speed_and_mode_are_those_of_before() -> None:
    async with on_a_cable("rplidar") as (cable, lidar):
        await lidar.set_scan_frequency(12.0)
        async with lidar.scans("Standard") as stream, lidar.scans() as other:
            await anext(stream)
            cable.pull()
            cable.plug()
            pulled = now()
            for each in (stream, other):
                scan = await next_after(each, pulled)
                assert scan.mode == "Standard"
                assert math.isclose(scan.rpm, 720, rel_tol=0.03)
        assert await lidar.get_scan_frequency() == 12.0
        # A device that comes back while nothing is wanted takes its settings, too.
        cable.pull()
        cable.plug()
        await asyncio.sleep(3.0)
        assert lidar.stats.reconnects == 2
        scan = await lidar.scan("Standard")
        assert math.isclose(scan.rpm, 720, rel_tol=0.03)


async def test_another_lidar_on_its_port_is_not_taken_for_it(rig: Rig, caplog: pytest.LogCaptureFixture) -> None:
    other = make_rig(rig.family, seed=7)
    async with on_a_cable(rig) as (cable, lidar):
        serial = lidar.info.serial
        async with scanning(lidar) as stream:
            cable.pull()
            cable.plug(other.device)
            await asyncio.sleep(5.0)
            assert not lidar.is_connected
            told = [each.message for each in caplog.records if "another lidar" in each.message]
            assert len(told) == 1, "said once, not at each attempt"
            assert serial in told[0]
            assert not any("scan" in name for name in names(other))
            cable.pull()
            cable.plug()
            await next_after(stream, now())
            assert lidar.info.serial == serial
    assert is_off(other.device)


async def test_a_program_that_blocks_its_loop_meanwhile(rig: Rig) -> None:
    loop = driven_loop()
    async with on_a_cable(rig) as (cable, lidar), scanning(lidar) as stream:
        cable.pull()
        cable.plug()
        for _ in range(12):
            loop.block(0.7)
            await asyncio.sleep(0.01)
        await next_after(stream, now())
        assert lidar.stats.reconnects >= 1


@pytest.mark.long
@both_families
@pytest.mark.exhaustive("points", sample=[4], full=[12])
def test_the_cable_is_pulled_out_again_at_every_step_of_coming_back(family: str, points: int) -> None:
    async def main(step: int) -> int:
        rig = make_rig(family)
        loop = driven_loop()
        with cable_to(rig) as cable:
            async with rig.read(reconnect=True) as (lidar, stream):
                cable.pull()
                cable.plug()
                first = loop.turns

                def replug() -> None:
                    cable.pull()
                    cable.plug()

                loop.after(step, replug)
                async with asyncio.timeout(30.0):
                    while lidar.stats.reconnects == 0 or loop.turns < first + step:
                        await asyncio.sleep(0.05)
                await next_after(stream, now())
                await next_after(stream, now() + 1.0)
                turns = loop.turns - first
        assert left_still(rig)
        return turns

    turns = run_driven(lambda: main(0))
    at_each(range(1, turns, max(1, turns // points)), main, "pulled out again")


@pytest.mark.long
@pytest.mark.parametrize("moment_s", [3.0, 3.3, 3.6, 3.9])
async def test_one_that_only_talks_comes_back_although_its_line_is_silent_at_times(moment_s: float) -> None:
    """What is silent for 0.3 s of each second is not still, though nothing responds. The replug takes 3 s."""
    source = f"sim://ydlidar-x4-pro?via=memory&fault=stall:300ms,replug:{moment_s}s"
    async with open_lidar(source, reconnect=True) as lidar, lidar.scans() as stream:
        async with asyncio.timeout(moment_s + 9.0):
            while not lidar.stats.reconnects:
                await anext(stream)
