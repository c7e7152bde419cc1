"""The registry's rows agree with what stands in the families' folders."""

from __future__ import annotations

import pytest

from lidario.errors import ConnectFailed
from lidario.families.base import Device, Family
from lidario.families.ldrobot.simulated.device import PROFILES as THIRD
from lidario.families.registry import FAMILIES, family_named, family_of_simulated
from lidario.families.rplidar.simulated.profiles import PROFILES as FIRST
from lidario.families.ydlidar.simulated.device import PROFILES as SECOND


def test_the_simulated_models_are_those_there_are() -> None:
    assert [set(family.simulated) for family in FAMILIES] == [set(FIRST), set(SECOND), set(THIRD)]


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_each_row_is_complete(family: Family) -> None:
    assert family_named(family.name) is family
    assert isinstance(family.device(), Device)
    for model in family.simulated:
        assert family_of_simulated(model) is family
        device = family.simulate(model, world=None, serial=None, seed=3)
        assert device.baudrate in family.baudrates or getattr(device, "is_network", False)
        assert not device.scanning
    types = [kind().response_type for kind in family.formats]
    assert len(set(types)) == len(types)


def test_unknown_names_are_answered_with_the_known_ones() -> None:
    for look_up in (family_named, family_of_simulated):
        with pytest.raises(ConnectFailed, match="known are") as caught:
            look_up("nonesuch")
        assert caught.value.reason == "source"


def test_a_misspelt_simulated_model_is_told_the_nearest_ones_and_not_all() -> None:
    with pytest.raises(
        ConnectFailed, match=r"'rplidar-s9'\. Did you mean .*rplidar-s2.*`lidario sim --list`"
    ) as caught:
        family_of_simulated("rplidar-s9")
    assert len(str(caught.value)) < 200
    assert "\n" not in str(caught.value)
