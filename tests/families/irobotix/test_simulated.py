"""The simulated devices: what they send, and what becomes of a motor that nobody powers as it should be."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import numpy as np
import pytest

from lidario import StreamFailed, open_lidar
from lidario.families.irobotix.simulated.device import PROFILES, make_simulated
from tests.reference import irobotix
from tests.support.devices import make_rig
from tests.support.loop import driven

S = 1_000_000_000
BEGIN = 1000 * S


def whole(data: bytes) -> list[bytes]:
    """The measurements in what was heard from anywhere on."""
    at = next(at for at in range(len(data)) if data[at : at + 2] == b"\xaa\x00" and data[at + 4] == 0x61)
    end = len(data)
    while True:
        try:
            return irobotix.split(data[at:end])
        except (ValueError, IndexError):
            end -= 1


@pytest.mark.parametrize("model", PROFILES)
def test_what_it_sends_is_what_the_world_holds(model: str) -> None:
    profile = PROFILES[model]
    device = make_simulated(model)
    device.transmit(BEGIN)
    packets = whole(device.transmit(BEGIN + S))
    assert len(packets) == pytest.approx(profile.slots * profile.hertz, abs=2)
    starts = [int.from_bytes(packet[11:13], "big") for packet in packets]
    assert all((b - a) % 36_000 == 36_000 // profile.slots for a, b in pairwise(starts))
    samples = irobotix.decode(packets, frames=profile.slots)
    assert len(samples) == pytest.approx(profile.rate, rel=0.05)
    angles = np.array([sample.angle_deg for sample in samples])
    distances = np.array([sample.distance_mm for sample in samples])
    seen = device.world.ranges_mm(angles, np.full(len(angles), BEGIN * 1e-9))
    assert np.median(np.abs(seen - distances)[distances > 0]) < 40


@pytest.mark.parametrize("rpm", [120.0, 720.0])
def test_a_rotor_that_is_too_slow_or_too_fast_is_told_and_makes_no_scans(rpm: float) -> None:
    rig = make_rig("irobotix", "irobotix-delta2a")

    @driven
    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with open_lidar(rig.device, family="irobotix") as lidar:
            with pytest.raises(StreamFailed, match=f"does not turn as it should: {rpm:.0f} revolutions a minute"):
                async for scan in lidar.scans():
                    if scan.seq == 3:
                        rig.device.power_motor(rpm, round(loop.time() * 1e9))
            assert "The host powers it" in (await lidar.get_health()).note
            rig.device.power_motor(420.0, round(loop.time() * 1e9))
            await asyncio.sleep(2.0)
            assert (await lidar.get_health()).ok
            for _ in range(3):
                scan = await lidar.scan()
            assert scan.reported_rpm == pytest.approx(420, abs=3)
        assert lidar.stats.skipped_bytes < 400

    main()
