"""A lidar of another machine is what its publisher has told."""

from __future__ import annotations

import pytest

import lidario
from lidario.errors import Unsupported
from lidario.ros import Share
from tests.support.network import Rig, until
from tests.support.router import Router


@pytest.mark.parametrize("model", ["rplidar-s2", "rplidar-a1", "ydlidar-x4"])
async def test_who_reads_raw_bytes_is_told_what_the_publisher_is(router: Router, model: str) -> None:
    async def told(lidar: lidario.Lidar) -> list[object]:
        found: list[object] = []
        for ask in (lidar.get_modes, lidar.get_sample_rate, lidar.get_scan_frequency_range, lidar.get_health):
            try:
                found.append(await ask())
            except Unsupported as error:
                found.append(str(error))
        return found

    async with Rig(router) as rig:
        lidar = await rig.enter_async_context(lidario.open_lidar(lidario.simulate(model, spin_up=0)))
        live = await told(lidar)
        share = await rig.enter_async_context(Share(lidar, f"told/{model}", raw=True, router=router.address))
        rig.run(share)
        await until(lambda: rig.sent)
        remote = await rig.enter_async_context(lidario.open_lidar(f"zenoh:{share.key}?router={router.address}"))
        assert await told(remote) == live
