"""The watchdog of a stream: what it waits for, what it reads before it judges, and what it names as the cause."""

import asyncio
import math
from typing import Any

import pytest

from lidario import ScanStream, StreamFailed
from lidario.basics.model import LineErrors
from lidario.port.port import Port
from lidario.revolution.seam import Seam
from lidario.session.talking.trouble import Trouble
from tests.support.devices import Rig, end_of, make_rig, scanning, some
from tests.support.loop import driven_loop, now, now_ns


def mix_revolutions(rig: Rig, until_s: float = math.inf) -> None:
    """Let bytes through for a fifth of a turn, every 2.25 turns: these parts of revolutions look like one."""
    clean, turn_ns = rig.device.transmit, round(rig.turn_s * 1e9)

    def transmit(now: int) -> bytes:
        data: bytes = clean(now)
        passes = not rig.device.scanning or now * 1e-9 > until_s
        return data if passes or now % (9 * turn_ns // 4) < turn_ns // 5 else b""

    rig.device.transmit = transmit


async def test_a_device_that_falls_silent_while_the_program_blocks_is_told_of(rig: Rig) -> None:
    loop = driven_loop()
    async with rig.read() as (_, stream):
        rig.device.mute = True
        loop.block(1.0)
        unblocked = loop.time()
        assert "no scan data" in str(await end_of(stream))
        # What came meanwhile may be on its way; then the device is asked what is wrong.
        assert loop.time() - unblocked < 0.6


async def test_what_is_held_is_read_before_it_counts_as_silent(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a terminal whose bytes nobody has read because its timers are late."""
    data_received, held = Port.data_received, bytearray()
    polls = 0

    def hold(self: Port, data: bytes, now: int) -> None:
        held.extend(data)

    def poll(self: Port) -> None:
        nonlocal polls
        polls += 1
        data = bytes(held)
        held.clear()
        if data:
            data_received(self, data)

    async with rig.open() as lidar, scanning(lidar, depth=100) as stream:
        monkeypatch.setattr(Port, "data_received", hold)
        monkeypatch.setattr(Port, "poll", poll)
        await some(stream, 30)
        monkeypatch.undo()
        assert polls >= 30 * rig.turn_s / 0.6 - 1
        assert lidar.stats.restarts == 0


@pytest.mark.parametrize(
    ("framing", "says"),
    [
        (0, r"missing\. Check the cable, the plug and the power supply"),
        (4, r"missing, with \d+ framing errors: the baud rate is wrong or the cable is bad"),
    ],
)
async def test_damage_is_told_with_what_the_driver_counted_at_that_time(
    rig: Rig, framing: int, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    counted, more = LineErrors(), LineErrors()

    def count(port: Port) -> LineErrors:
        nonlocal counted
        counted += more
        return counted

    monkeypatch.setattr(Port, "errors", property(count))
    async with rig.read() as (_, stream):
        counted = LineErrors(overruns=40)
        await anext(stream)
        mix_revolutions(rig)
        more = LineErrors(framing=framing)
        why = str(await end_of(stream, why=r"no full revolution .*it lacks [1-9]\d* packets?, damaged or " + says))
    assert "overrun" not in why


async def read_through_damage(rig: Rig, stream: ScanStream) -> None:
    """Read scans while revolutions are mixed, and some behind that."""
    await anext(stream)
    mix_revolutions(rig, now() + 7 * rig.turn_s)
    await some(stream, 8)


@pytest.mark.long
async def test_damage_before_the_last_scan_is_not_the_cause(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    async with rig.open() as lidar, lidar.scans() as stream:
        await read_through_damage(rig, stream)
        assert lidar.stats.broken_scans > 0
        monkeypatch.setattr(Seam, "splits", lambda *_: [])
        why = str(await end_of(stream))
    assert "is the rotor blocked?" in why


async def test_a_discarded_revolution_is_told_once(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[object] = []
    monkeypatch.setattr(Trouble, "tell", lambda _, message, *values: told.append((message, *values)))
    async with rig.open() as lidar, lidar.scans() as stream:
        await read_through_damage(rig, stream)
        broken = lidar.stats.broken_scans
    assert broken > 0
    assert told == [("revolutions discarded: %d so far", number) for number in range(1, broken + 1)]


@pytest.mark.parametrize(("network", "pause_s"), [(False, 0.5), (False, 0.7), (True, 0.8), (True, 1.0)])
async def test_a_network_may_pause_for_longer_than_a_serial_line(
    rig: Rig, network: bool, pause_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that was held back comes at once behind the pause."""
    if network:
        monkeypatch.setattr("lidario.port.simulated.Port", lambda name, _: Port(name))
    async with rig.read() as (lidar, stream):
        clean, held = rig.device.transmit, bytearray()
        until_ns = now_ns() + round(pause_s * 1e9)

        def transmit(at_ns: int) -> bytes:
            held.extend(clean(at_ns))
            data = b"" if at_ns < until_ns else bytes(held)
            del held[: len(data)]
            return data

        rig.device.transmit = transmit
        await some(stream, 12)
        assert lidar.stats.restarts == (pause_s > (0.9 if network else 0.6))


async def test_a_device_behind_a_network_may_respond_late_when_it_is_asked_why_it_is_silent(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a serial line 0.25 s would be enough."""
    monkeypatch.setattr("lidario.port.simulated.Port", lambda name, _: Port(name))
    async with rig.read() as (lidar, stream):
        rig.device.halt(now_ns())
        rig.device.response_delay_s = 0.4
        await some(stream, 3)
        assert lidar.stats.restarts == 1


@pytest.mark.parametrize("dips", [1, 9])
async def test_a_device_that_restarts_as_its_rotor_speeds_up_is_started_again(dips: int) -> None:
    """The motor's start takes its supply down, when the first packets have come and no revolution has."""
    rig = make_rig("rplidar-a1")
    rig.device.spin_up_s = 2.0
    left, loop = [dips], asyncio.get_running_loop()
    async with rig.open() as lidar:
        start = rig.device.HANDLERS["express_scan"]

        def dip(device: Any, request: Any) -> Any:
            why = start(device, request)
            if left[0]:
                left[0] -= 1
                loop.call_later(0.1, lambda: device.reboot(now_ns()))
            return why

        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(type(rig.device).HANDLERS, "express_scan", dip)
            async with lidar.scans() as stream:
                if dips == 1:
                    await some(stream, 3)
                else:
                    why = str(await end_of(stream, StreamFailed))
                    assert "the fourth time within 60 s" in why
                    assert "Is the power supply strong enough?" in why
        assert lidar.stats.restarts == min(dips, 3)
