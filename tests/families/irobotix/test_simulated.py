"""The simulated devices: what becomes of a motor that nobody powers as it should be."""

import asyncio

import pytest

from lidario import StreamFailed
from tests.support.devices import make_rig
from tests.support.loop import now_ns


@pytest.mark.parametrize("rpm", [120.0, 720.0])
async def test_a_rotor_that_is_too_slow_or_too_fast_is_told_and_makes_no_scans(rpm: float) -> None:
    rig = make_rig("irobotix-delta2a")
    async with rig.open() as lidar:
        with pytest.raises(StreamFailed, match=f"does not turn as it should: {rpm:.0f} revolutions a minute"):
            async for scan in lidar.scans():
                if scan.seq == 3:
                    rig.device.power_motor(rpm, now_ns())
        assert "The host powers it" in (await lidar.get_health()).note
        rig.device.power_motor(420.0, now_ns())
        await asyncio.sleep(2.0)
        assert (await lidar.get_health()).ok
        for _ in range(3):
            scan = await lidar.scan()
        assert scan.reported_rpm == pytest.approx(420, abs=3)
    assert lidar.stats.skipped_bytes < 400
