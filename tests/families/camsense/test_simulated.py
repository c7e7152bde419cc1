"""The simulated devices: how they come up."""

import pytest

from lidario.families.camsense.simulated import PROFILES
from tests.support.devices import Rig
from tests.support.loop import now_ns


@pytest.mark.parametrize("rig", PROFILES, indirect=True)
async def test_a_session_through_a_power_cut(rig: Rig) -> None:
    async with rig.read(reconnect=True) as (lidar, stream):
        x1 = rig.device.profile is PROFILES["camsense-x1"]
        assert lidar.info.model == ("Camsense X1" if x1 else "LDS08RR of Camsense")
        rig.device.reboot(now_ns(), off_s=1.0)
        for _ in range(5):
            scan = await anext(stream)
        assert len(scan) == pytest.approx(400, abs=8)
    assert rig.device.log == []
