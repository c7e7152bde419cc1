"""What a device says of itself, in words."""

from __future__ import annotations

import pytest

from lidario.families.hokuyo.device import FORMATS, HokuyoDevice, mode_for
from lidario.families.hokuyo.simulated.device import pack_lines
from lidario.model import Health, HealthStatus
from tests.families.hokuyo.about import GEOMETRY
from tests.support.scripts import played

STATES = {
    "Sensor works well.": Health(HealthStatus.OK, 0),
    "Stable 000 no error.": Health(HealthStatus.OK, 0),
    "malfunction 32": Health(HealthStatus.ERROR, 32, "it says: malfunction 32"),
    "Internal failure": Health(HealthStatus.ERROR, 0, "it says: Internal failure"),
    "Warming up 7": Health(HealthStatus.WARNING, 7, "it says: Warming up 7"),
    "Warming up": Health(HealthStatus.WARNING, 0, "it says: Warming up"),
}


@pytest.mark.parametrize("state", STATES)
def test_its_health_is_told_in_words(state: str) -> None:
    response = pack_lines(b"II", [f"STAT:{state}"], counts_semicolon=False)
    payload = response.removeprefix(b"II\n").removesuffix(b"\n\n")
    assert played(HokuyoDevice().health(), lambda _: payload) == STATES[state]


def test_it_measures_distances_alone_where_nothing_else_is_asked_for() -> None:
    modes = [mode_for(wire, GEOMETRY) for wire in FORMATS]
    assert [(mode.name, mode.typical) for mode in modes] == [("Standard", True), ("Intensity", False)]
