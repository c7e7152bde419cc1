"""A fresh simulated device on a bench, for the tests of what it does."""

import pytest

from tests.support.simulated_rplidar import Bench


@pytest.fixture
def bench() -> Bench:
    return Bench()
