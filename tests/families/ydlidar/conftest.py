"""A fresh simulated 4ROS, on a bench or by itself."""

import pytest

from lidario.families.ydlidar.simulated.device import Simulated4Ros, make_simulated
from lidario.sim.rooms import make_world
from tests.support.simulated_4ros import Bench


@pytest.fixture
def bench() -> Bench:
    return Bench(make_simulated("ydlidar-4ros", serial=bytes.fromhex("2023061500001234")))


@pytest.fixture
def device() -> Simulated4Ros:
    return make_simulated("ydlidar-4ros", world=make_world("circle"), serial=bytes.fromhex("0123456789012345"))
