"""What a user reads where noise or damage keeps a stream from giving scans: no guess that does not fit."""

from __future__ import annotations

import asyncio

import pytest

from lidario import StreamFailed, open_lidar
from lidario.revolution.ended import EndedRevolution
from tests.support.loop import driven

pytestmark = pytest.mark.discards("a line full of noise, and one that drops bytes")
BOUND_S = 30.0


@driven
async def test_a_line_that_is_never_quiet_is_not_called_a_device_that_goes_on_sending() -> None:
    async with open_lidar("sim://rplidar-s2?via=memory&fault=babble:1000&seed=3") as lidar:
        with pytest.MonkeyPatch.context() as patch:
            # As if too little came through for a scan.
            patch.setattr(EndedRevolution, "is_broken", lambda *_: True)
            with pytest.raises(StreamFailed, match="the device does not hear them, or it is noise on the line"):
                async with asyncio.timeout(BOUND_S), lidar.scans() as stream:
                    async for _ in stream:
                        pass


@driven
async def test_revolutions_that_damage_spoils_are_not_called_a_blocked_rotor() -> None:
    async with open_lidar("sim://rplidar-s2?via=memory&fault=drop:0.05%&seed=3") as lidar, lidar.scans() as stream:
        await anext(stream)
        with pytest.MonkeyPatch.context() as patch:
            # As if every revolution were damaged too much.
            patch.setattr(EndedRevolution, "is_broken", lambda *_: True)
            with pytest.raises(StreamFailed, match=r"no full revolution .*: \d+ packets of it are damaged"):
                async with asyncio.timeout(BOUND_S):
                    async for _ in stream:
                        pass
