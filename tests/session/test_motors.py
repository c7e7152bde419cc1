"""Models whose motor takes no speed, in driven time: an A1 by DTR, an A2 by an accessory board, a C1 by itself.

That they are left still by whatever ends a program is in `test_cancellation` and `test_two_tasks`.
"""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from lidario import HealthStatus, Unsupported
from lidario.sim.rooms import make_world
from tests.support.devices import FAMILIES, SWITCHED, Rig, discarded, left_still, make_rig, names, take
from tests.support.loop import driven, now_ns

TURNS_S = {"rplidar-a1": 60 / 428, "rplidar-a2": 0.1, "rplidar-a3": 0.1, "rplidar-c1": 0.1}
switched = pytest.mark.parametrize("model", SWITCHED)


def rig_of(model: str) -> Rig:
    rig = make_rig(model, world=make_world("circle"))
    rig.turn_s = TURNS_S.get(model, rig.turn_s)
    return rig


@pytest.mark.parametrize("model", [*FAMILIES, *TURNS_S])
@driven
async def test_scans_show_the_world_and_the_device_is_left_still(model: str) -> None:
    rig = rig_of(model)
    async with rig.open() as lidar:
        assert lidar.health.status is HealthStatus.OK
        scans = await take(lidar, 5)
        assert [scan.seq for scan in scans] == [0, 1, 2, 3, 4]
        for scan in scans:
            np.testing.assert_allclose(scan.ranges, 2.0, atol=0.006 if model in TURNS_S else 0.002)
            steps = np.diff(np.unwrap(scan.angles.astype(np.float64)))
            assert (steps < 0).all(), "the device turns clockwise, so angles fall"
            assert abs(len(scan) * steps.mean()) == pytest.approx(2 * np.pi, rel=0.01)
            assert scan.lost_packets == scan.dropped_before == 0
        assert scans[-1].rpm == pytest.approx(60 / rig.turn_s, rel=0.01)
        assert left_still(rig)
        assert len(await take(lidar, 2)) == 2
        # What the device was still sending when it was stopped belongs to the stream.
        await asyncio.sleep(0.1)
        assert lidar.stats.stray_bytes == 0
    assert left_still(rig)


@pytest.mark.parametrize("mode", ["Standard", "Express", "Boost", "Stability", "Legacy express"])
@switched
@driven
async def test_every_mode_by_name(model: str, mode: str) -> None:
    rig = rig_of(model)
    async with rig.open() as lidar:
        async with lidar.scans(mode) as stream:
            scan = await anext(stream)
            assert scan.lost_packets == 0
            # The slowest packets are 19.3 ms apart, and the line is only quiet when none comes.
            await lidar.get_health()
            await anext(stream)
        assert lidar.stats.stray_bytes == 0
    assert left_still(rig)


@driven
async def test_the_way_is_decided_once() -> None:
    rig = rig_of("rplidar-a2")
    async with rig.open() as lidar:
        for _ in range(3):
            await take(lidar, 1)
    assert names(rig).count("get_acc_board_flag") == 1
    assert names(rig).count("set_motor_pwm") == 6


@pytest.mark.parametrize("model", ["rplidar-a2-no-board", "rplidar-c1-fixed"])
@driven
async def test_a_motor_without_control_is_left_alone(model: str) -> None:
    rig = make_rig(model)
    async with rig.open() as lidar:
        await take(lidar, 1)
        await take(lidar, 1)
        with pytest.raises(Unsupported, match="no motor control"):
            await lidar.set_scan_frequency(10.0)
    assert not rig.device.scanning
    assert "stop" in names(rig)
    assert len(discarded(rig)) <= 2


@switched
@driven
async def test_a_speed_is_refused_and_the_stream_goes_on(model: str) -> None:
    rig = rig_of(model)
    async with rig.open() as lidar, lidar.scans() as stream:
        await anext(stream)
        for request in (lidar.set_scan_frequency(8.0), lidar.get_scan_frequency()):
            with pytest.raises(Unsupported, match=r"Scan\.rpm"):
                await request
        assert (await anext(stream)).lost_packets == 0
        assert lidar.stats.interruptions == 0


@driven
async def test_a_c1_takes_a_speed() -> None:
    rig = rig_of("rplidar-c1")
    async with rig.open() as lidar:
        assert await lidar.set_scan_frequency(8.0) == 8.0
        assert (await take(lidar, 3))[-1].rpm == pytest.approx(480, rel=0.01)


@driven
async def test_an_empty_list_of_modes() -> None:
    rig = make_rig("rplidar-a2-empty-list")
    async with rig.open() as lidar:
        assert [(mode.id, mode.name) for mode in await lidar.get_modes()] == [(0, "Standard"), (0, "Express")]
        assert {len(scan) for scan in await take(lidar, 3)} <= {399, 400, 401}


@driven
async def test_hq_scan_by_name() -> None:
    rig = make_rig("rplidar-hq")
    async with rig.open() as lidar:
        assert len(await lidar.scan("HQ scan")) == pytest.approx(1000, abs=2)
    assert "hq_scan" in names(rig)


@switched
@driven
async def test_a_reboot_in_mid_scan_is_survived(model: str) -> None:
    """An accessory board has forgotten the duty, and an A1 has printed its banner."""
    rig = rig_of(model)
    loop = asyncio.get_running_loop()
    async with rig.open() as lidar, lidar.scans() as stream:
        await anext(stream)
        rig.device.reboot(now_ns(), off_s=0.2)
        before = loop.time()
        await anext(stream)
        await anext(stream)
        assert loop.time() - before < 5
    assert left_still(rig)


@driven
async def test_a_board_whose_responses_were_lost_is_found_when_no_packet_comes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = rig_of("rplidar-a2")
    lost = 2
    flag = type(rig.device).HANDLERS["get_acc_board_flag"]

    def lose(device: object, request: object) -> str:
        nonlocal lost
        lost -= 1
        return "" if lost >= 0 else flag(device, request)

    monkeypatch.setitem(type(rig.device).HANDLERS, "get_acc_board_flag", lose)
    async with rig.open() as lidar:
        assert len(await lidar.scan()) > 1000
        assert lidar.stats.restarts == 1
    assert names(rig).count("get_acc_board_flag") == 3
    assert left_still(rig)
