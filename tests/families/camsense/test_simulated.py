"""The simulated devices: how they come up."""

from __future__ import annotations

import asyncio

import pytest

from lidario import open_lidar
from lidario.families.camsense.simulated.device import PROFILES
from tests.support.devices import make_rig
from tests.support.loop import driven


@pytest.mark.parametrize("model", PROFILES)
@driven
async def test_a_session_through_a_power_cut(model: str) -> None:
    rig = make_rig("camsense", model)
    async with open_lidar(rig.device, family="camsense", reconnect=True) as lidar, lidar.scans() as stream:
        assert lidar.info.model == ("Camsense X1" if model.endswith("x1") else "LDS08RR of Camsense")
        await anext(stream)
        rig.device.reboot(round(asyncio.get_running_loop().time() * 1e9), off_s=1.0)
        for _ in range(5):
            scan = await anext(stream)
        assert len(scan) == pytest.approx(400, abs=8)
    assert rig.device.log == []
