"""What tests of sessions share."""

from __future__ import annotations

import pytest

from tests.support.devices import FAMILIES, Rig, make_rig


@pytest.fixture(params=FAMILIES)
def rig(request: pytest.FixtureRequest) -> Rig:
    """A device of each family that obeys requests, or of the models that `request` names."""
    return make_rig(request.param)


@pytest.fixture
def rplidar() -> Rig:
    """One of them."""
    return make_rig("rplidar")


@pytest.fixture
def ydlidar() -> Rig:
    """The other one."""
    return make_rig("ydlidar")
