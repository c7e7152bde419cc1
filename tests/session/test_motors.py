"""Models whose motor takes no speed, in driven time: an A1 by DTR, an A2 by an accessory board, a C1 by itself.

Cancelled and in two tasks they are tried in `test_cancellation` and `test_two_tasks`.
"""

import asyncio
from collections.abc import Iterator
from contextlib import suppress
from itertools import product

import numpy as np
import pytest

from lidario import InvalidValue, Unsupported, open_lidar
from lidario.sim.faults import parse_faults
from lidario.sim.rooms import make_world
from tests.support.devices import (
    SWITCHED,
    Rig,
    hears_only,
    leave_streaming,
    left_still,
    left_still_at_the_end,
    make_rig,
    names,
    take,
)
from tests.support.loop import now, now_ns

TURNS_S = {"rplidar-a1": 60 / 428, "rplidar-a2": 0.1, "rplidar-a3": 0.1, "rplidar-c1": 0.1}
switched = pytest.mark.parametrize("rig", SWITCHED, indirect=True)


@pytest.fixture(params=TURNS_S)
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    """In a round room."""
    made = make_rig(request.param, world=make_world("circle"))
    made.turn_s = TURNS_S.get(request.param, made.turn_s)
    with left_still_at_the_end(made):
        yield made


async def test_one_that_was_left_scanning_is_stopped_shows_the_world_and_is_left_still(rig: Rig) -> None:
    leave_streaming(rig.device, now_ns())
    async with rig.open() as lidar:
        assert not rig.device.scanning
        scans = await take(lidar, 4)
        assert [scan.seq for scan in scans] == [0, 1, 2, 3]
        for scan in scans:
            np.testing.assert_allclose(scan.ranges, 2.0, atol=0.006)
        assert scans[-1].rpm == pytest.approx(60 / rig.turn_s, rel=0.01)
        assert left_still(rig)
        assert len(await take(lidar, 2)) == 2
        # What the device was still sending when it was stopped belongs to the stream.
        await asyncio.sleep(0.1)
        assert lidar.stats.stray_bytes == 0


MODES = ("Standard", "Express", "Boost", "Stability", "Legacy express")


@pytest.mark.parametrize(("rig", "mode"), [*product(SWITCHED, MODES), ("rplidar-hq", "HQ scan")], indirect=["rig"])
async def test_every_mode_by_name(rig: Rig, mode: str) -> None:
    async with rig.open() as lidar:
        async with lidar.scans(mode) as stream:
            scan = await anext(stream)
            assert scan.lost_packets == 0
            assert mode != "HQ scan" or ("hq_scan" in names(rig) and 998 <= len(scan) <= 1002)
            # The slowest packets are 19.3 ms apart, and the line is only quiet when none comes.
            await lidar.get_health()
            await anext(stream)
        assert lidar.stats.stray_bytes == 0


@pytest.mark.parametrize(
    ("model", "why"), [("rplidar-a2-no-board", "no motor control"), ("rplidar-c1-fixed", "takes none")]
)
async def test_a_motor_without_control_is_left_alone(model: str, why: str) -> None:
    rig = make_rig(model)
    async with rig.open() as lidar:
        await take(lidar, 1)
        await take(lidar, 1)
        asked = names(rig, obeyed=False)
        with pytest.raises(Unsupported, match=why):
            await lidar.set_scan_frequency(10.0)
    assert not rig.device.scanning
    assert "stop" in names(rig)
    # What stops the motor of one that takes a speed or a duty: whether this one does, may only have been lost on
    # the way.
    stops = ("motor_speed_ctrl", "set_motor_pwm")
    assert len([name for name in asked if name not in stops]) <= 2


@pytest.mark.long
@pytest.mark.exhaustive(
    "fault",
    sample=["drop:0.1%", "reboot:2s", "protect:2s"],
    full=["drop:0.1%", "flip:0.1%", "reboot:2s", "late:0.05s", "protect:2s", "duplicate:0.1%"],
)
@switched
async def test_scans_go_on_after_a_fault(rig: Rig, fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind a reboot an accessory board has forgotten the duty, and an A1 has printed its banner."""
    monkeypatch.setattr("lidario.port.simulated.make_device", lambda _: (rig.device, parse_faults(fault, seed=1)))
    async with open_lidar("sim://rplidar-a1?via=memory") as lidar, lidar.scans() as stream:
        began = now()
        async for scan in stream:
            # A sum of eight bits lets one damaged packet in 256 through.
            assert np.mean(np.abs(scan.ranges[scan.ranges > 0] - 2.0) < 0.05) > 0.98
            if now() > began + 6:
                break
        assert now() < began + 8
        assert lidar.stats.scans > 10


@pytest.mark.parametrize("lost", [2, 4, 6, 9])
async def test_questions_in_vain_do_not_decide_which_speeds_are_taken(rplidar: Rig, lost: int) -> None:
    """Its limits are asked for again, and a speed beyond them is refused."""
    left = lost

    def hears(data: bytes) -> bool:
        nonlocal left
        left -= data.startswith(b"\xa5\x84")
        return left < 0 or not data.startswith(b"\xa5\x84")

    async with rplidar.open() as lidar:
        await lidar.get_modes()
        hears_only(rplidar, hears)
        while left > 0:
            with suppress(Unsupported):
                await lidar.get_scan_frequency_range()
        assert await lidar.get_scan_frequency_range() == (8.0, 20.0)
        with pytest.raises(InvalidValue, match="outside of this device's"):
            await lidar.set_scan_frequency(200.0)
        assert await lidar.set_scan_frequency(12.0) == 12.0
