"""Another speed of the line, while other tasks cancel, stop, or want yet another one."""

from __future__ import annotations

import asyncio

import pytest

from lidario import Unsupported
from tests.support.devices import Rig, left_still, make_rig, names, take
from tests.support.loop import driven_loop, run_driven


@pytest.mark.parametrize("after_s", [0.0, 0.02, 0.2, 0.34, 0.4])
async def test_cancelled_at_any_time_the_device_is_reached_and_left_still(rplidar: Rig, after_s: float) -> None:
    async with rplidar.open() as lidar:
        await take(lidar, 1)
        changing = asyncio.ensure_future(lidar.set_baudrate(921_600))
        await asyncio.sleep(after_s)
        changing.cancel()
        await asyncio.wait([changing])
        # A device that was measured and got no confirmation goes back within a second.
        await asyncio.sleep(1.1)
        assert lidar.baudrate == rplidar.device.baudrate
        assert (await lidar.get_health()).ok


@pytest.mark.parametrize("after_s", [0.0, 0.34, 0.4, 0.5])
async def test_who_only_waits_for_another_change_and_is_cancelled_leaves_the_speed_alone(
    rplidar: Rig, after_s: float
) -> None:
    async with rplidar.open() as lidar:
        await take(lidar, 1)
        changing = asyncio.ensure_future(lidar.set_baudrate(921_600))
        waiting = asyncio.ensure_future(lidar.set_baudrate(1_500_000))
        await asyncio.sleep(after_s)
        waiting.cancel()
        await changing
        assert (await lidar.get_health()).ok
        assert lidar.baudrate == rplidar.device.baudrate == 921_600


async def test_a_change_in_vain_behind_another_goes_back_to_that_ones_speed(
    rplidar: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    hear = rplidar.device.line_speed.hear
    monkeypatch.setattr(
        rplidar.device.line_speed,
        "hear",
        lambda data, now: hear(data, now) if rplidar.device.baudrate == 1_000_000 else b"",
    )
    async with rplidar.open() as lidar:
        first, second = (asyncio.ensure_future(lidar.set_baudrate(each)) for each in (921_600, 1_500_000))
        with pytest.raises(Unsupported, match="stays 921600"):
            await second
        await first
        assert (await lidar.get_health()).ok
        assert lidar.baudrate == rplidar.device.baudrate == 921_600


@pytest.mark.long
@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("model", ["rplidar-s2", "rplidar-a2"])
def test_cancelled_at_any_step_it_is_left_still_although_it_may_have_taken_the_new_speed(
    model: str, closed: bool
) -> None:
    """Measured and not confirmed, it hears nothing at the speed before until it has gone back, within a second."""

    async def cancelled_at(turn: int) -> int:
        made, loop = make_rig(model), driven_loop()
        async with made.open() as lidar:
            await lidar.scan()
            changing, first = asyncio.ensure_future(lidar.set_baudrate(921_600)), loop.turns
            loop.after(turn, changing.cancel)
            await asyncio.wait([changing])
            took = loop.turns - first
            if not closed:
                await asyncio.sleep(4.0)
                assert not made.device.motor_on, f"cancelled at {turn}"
        assert left_still(made), f"cancelled at {turn}"
        return took

    for turn in range(1 + closed, run_driven(lambda: cancelled_at(0)) + 1, 2):
        run_driven(lambda turn=turn: cancelled_at(turn))  # type: ignore[misc]


@pytest.mark.parametrize("rig", ["rplidar-s2", "rplidar-a2"], indirect=True)
@pytest.mark.parametrize("step", range(1, 20, 2))
async def test_stopped_by_another_task_meanwhile_it_is_stopped_as_soon_as_the_speed_is_decided(
    rig: Rig, step: int
) -> None:
    due = asyncio.Event()
    async with rig.open() as lidar:
        await lidar.scan()
        changing = asyncio.ensure_future(lidar.set_baudrate(921_600))
        driven_loop().after(step, due.set)
        await due.wait()
        await lidar.stop()
        await changing
        assert lidar.baudrate == rig.device.baudrate == 921_600
        await asyncio.sleep(2.0)
        assert left_still(rig), names(rig)[-5:]
