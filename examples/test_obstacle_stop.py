"""The robot's own test: no lidar, no waiting. Run it with pytest, which finds the fixture by itself."""

import math

import pytest
from obstacle_stop import drive

from lidario.testing import Body, SimulatedLidar

COMES = [Body([(0, 1.9, 0.0), (3, 0.6, 0.0)], radius=0.2)]

pytestmark = pytest.mark.asyncio  # or pytest.mark.anyio


async def test_it_stops_in_front_of_a_person(simulated_lidar: SimulatedLidar) -> None:
    simulated_lidar.show(bodies=COMES)
    assert 0.35 < await drive(simulated_lidar) < 0.5
    assert simulated_lidar.is_still


async def test_it_ignores_who_passes_at_its_side(simulated_lidar: SimulatedLidar) -> None:
    simulated_lidar.show(bodies=[Body([(0, 1.0, 0.8), (3, -1.0, 0.8)], radius=0.2)])
    assert await drive(simulated_lidar, seconds=3.0) == math.inf


@pytest.mark.simulated_lidar(bodies=COMES, fault="replug:1s")
async def test_it_stops_although_the_cable_is_loose(simulated_lidar: SimulatedLidar) -> None:
    assert await drive(simulated_lidar, seconds=10.0) < 0.5
