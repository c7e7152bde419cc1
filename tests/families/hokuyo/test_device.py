"""What a device says of itself, in words, and on a poor line: each scan is one packet that a lost byte damages."""

import pytest

from lidario import RemoteProtocolError, open_lidar
from lidario.families.hokuyo.commands import check_of
from lidario.families.hokuyo.device import FORMATS, HokuyoDevice, mode_for
from lidario.families.hokuyo.simulated.device import pack_lines
from lidario.model import Health, HealthStatus
from lidario.testing import SimulatedLidar
from lidario.wire.envelope import Request
from tests.families.hokuyo.about import GEOMETRY
from tests.support.devices import take
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


@pytest.mark.parametrize("model", ["hokuyo-urg04lx", "hokuyo-utm30lx"])
async def test_many_damaged_scans_in_a_row_do_not_end_a_stream(model: str) -> None:
    """Two of three scans are damaged, or more, where each is one packet of two thousand bytes."""
    device = SimulatedLidar(model, fault="drop:0.05%")
    async with open_lidar(device) as lidar:
        assert len(await take(lidar, 100)) == 100


def lines(**fields: object) -> bytes:
    """A response as it stands behind the echo: a status and the fields, each line with its check character."""
    told = [f"{name}:{value};".encode() for name, value in fields.items()]
    return b"\n".join(line + bytes((check_of(line),)) for line in (b"00", *told))


FIELD: dict[str, object] = {
    "MODL": "URG-04LX", "DMIN": 20, "DMAX": 5600, "ARES": 1024, "AMIN": 44, "AMAX": 725, "AFRT": 384, "SCAN": 600,
}  # fmt: skip


@pytest.mark.parametrize("spoilt", [0, 1, 2])
def test_a_field_that_cannot_be_is_asked_for_again(spoilt: int) -> None:
    """One damaged line in 64 passes for a whole one."""
    fields = iter([lines(**FIELD | {"AMIN": 900})] * spoilt + [lines(**FIELD)])
    asked = 0

    def answer(request: Request) -> bytes:
        nonlocal asked
        asked += b"PP" in request.data
        return next(fields) if b"PP" in request.data else lines(PROD="URG")

    if spoilt == 2:
        with pytest.raises(RemoteProtocolError, match=r"cannot be: .*AMIN:900"):
            played(HokuyoDevice().identify(), answer)
    else:
        assert played(HokuyoDevice().identify(), answer).model == "Hokuyo URG-04LX"
    assert asked == min(1 + spoilt, 2)
