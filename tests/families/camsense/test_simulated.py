"""The simulated devices: what they send is what the world holds, and how they come up."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from lidario import open_lidar
from lidario.families.camsense.simulated.device import PROFILES, make_simulated
from tests.reference import camsense
from tests.support.devices import make_rig
from tests.support.loop import driven

S = 1_000_000_000
BEGIN = 1000 * S


def test_what_it_sends_is_what_the_world_holds() -> None:
    device = make_simulated("camsense-x1")
    device.transmit(BEGIN)
    data = device.transmit(BEGIN + S)
    at = data.index(b"\x55\xaa\x03\x08")
    packets = camsense.split(data[at : at + (len(data) - at) // 36 * 36])
    assert len(packets) == pytest.approx(260, abs=2)
    samples = camsense.decode(packets)[:400]
    angles, distances = (
        np.array([getattr(each, name) for each in samples]) for name in ("angle_deg", "distance_mm")
    )
    assert (distances > 0).mean() > 0.8
    seen = device.world.ranges_mm(angles, np.full(len(angles), BEGIN * 1e-9))
    assert np.median(np.abs(seen - distances)[distances > 0]) < 40


def test_bytes_do_not_depend_on_the_steps_of_time() -> None:
    one, other = make_simulated("camsense-x1", seed=3), make_simulated("camsense-x1", seed=3)
    one.transmit(BEGIN)
    other.transmit(BEGIN)
    in_steps = b"".join(other.transmit(BEGIN + step * S // 100) for step in range(1, 101))
    assert one.transmit(BEGIN + S) == in_steps


@pytest.mark.parametrize("model", PROFILES)
def test_a_session_through_a_power_cut(model: str) -> None:
    rig = make_rig("camsense", model)

    @driven
    async def main() -> None:
        async with open_lidar(rig.device, family="camsense", reconnect=True) as lidar, lidar.scans() as stream:
            assert lidar.info.model == ("Camsense X1" if model.endswith("x1") else "LDS08RR of Camsense")
            await anext(stream)
            rig.device.reboot(round(asyncio.get_running_loop().time() * 1e9), off_s=1.0)
            for _ in range(5):
                scan = await anext(stream)
            assert len(scan) == pytest.approx(400, abs=8)

    main()
    assert rig.device.log == []
