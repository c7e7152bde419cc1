"""The robot's own test: no lidar, no waiting. Run pytest in its folder; the fixture is found by itself."""

import obstacle_stop
import pytest

from lidario.testing import Body, SimulatedLidar

COMES = [Body([(0, 1.9, 0.0), (3, 0.6, 0.0)], radius=0.2)]

pytestmark = pytest.mark.asyncio  # or pytest.mark.anyio


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the wheels were told, 20 times a second."""
    speeds: list[float] = []
    monkeypatch.setattr(obstacle_stop, "set_wheels", speeds.append)
    return speeds


async def test_it_stops_in_front_of_a_person(simulated_lidar: SimulatedLidar, told: list[float]) -> None:
    simulated_lidar.show(bodies=COMES)
    await obstacle_stop.drive(simulated_lidar, seconds=5.0)
    drove = told.index(0.4)
    assert set(told[told.index(0.0, drove) :]) == {0.0}  # once it stands, it stands
    assert told.count(0.4) > 20
    assert simulated_lidar.is_still


async def test_it_ignores_who_passes_at_its_side(simulated_lidar: SimulatedLidar, told: list[float]) -> None:
    simulated_lidar.show(bodies=[Body([(0, 1.0, 0.8), (3, -1.0, 0.8)], radius=0.2)])
    await obstacle_stop.drive(simulated_lidar, seconds=3.0)
    assert set(told[told.index(0.4) : -1]) == {0.4}


@pytest.mark.simulated_lidar(fault="replug:2s")
async def test_it_stands_while_the_cable_is_out(simulated_lidar: SimulatedLidar, told: list[float]) -> None:
    await obstacle_stop.drive(simulated_lidar, seconds=10.0)
    out = told.index(0.0, told.index(0.4))
    assert 0.4 in told[out:]  # and drives on when it is back
    assert told[-1] == 0.0
