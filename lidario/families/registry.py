"""Name -> family: the only place that lists vendors. A new one is a folder beside this file and a row here."""

from __future__ import annotations

from lidario.errors import ConnectFailed
from lidario.families import rplidar, ydlidar
from lidario.families.base import Family

__all__ = ["FAMILIES", "family_named", "family_of_simulated"]

FAMILIES: tuple[Family, ...] = (rplidar.FAMILY, ydlidar.FAMILY)
"""In the order in which an unknown port is probed: the second family's device-info request means something else
to the first, so the first is asked first."""


def family_named(name: str) -> Family:
    """The family of that name; ConnectFailed (reason ``source``) when there is none."""
    for family in FAMILIES:
        if family.name == name:
            return family
    known = ", ".join(family.name for family in FAMILIES)
    raise ConnectFailed(f"there is no lidar family {name!r}; known are {known}", reason="source")


def family_of_simulated(model: str) -> Family:
    """The family that has a simulated `model`; ConnectFailed (reason ``source``) when none has."""
    for family in FAMILIES:
        if model in family.simulated:
            return family
    known = ", ".join(name for family in FAMILIES for name in family.simulated)
    raise ConnectFailed(f"there is no simulated lidar {model!r}; known are {known}", reason="source")
