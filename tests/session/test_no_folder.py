"""The working folder of the program was removed, as that of a service whose release was replaced: lidars work."""

from pathlib import Path

import pytest

import lidario
from lidario.basics.source import parse_source
from lidario.basics.system import real_path
from lidario.port.guard import wait_for_guard
from lidario.session.finding.places import Places
from tests.support.devices import EVERY_FAMILY, left_still, make_rig


@pytest.fixture(autouse=True)
def removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "release"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()


@pytest.mark.parametrize("family", EVERY_FAMILY)
async def test_a_session(family: str) -> None:
    rig = make_rig(family)
    async with rig.open(reconnect=True) as lidar:
        await lidar.scan()
    assert left_still(rig)


@pytest.mark.real_time
@pytest.mark.parametrize("via", ["pty", "tcp"])
async def test_a_simulated_lidar_that_is_served(via: str) -> None:
    async with lidario.open_lidar(f"sim://rplidar-s2?via={via}", reconnect=True) as lidar:
        assert (await lidar.get_health()).ok


async def test_a_port_that_is_not_there() -> None:
    with pytest.raises(lidario.ConnectFailed, match=r"^no such port: 'ttyUSB0'"):
        await lidario.open_lidar("ttyUSB0", reconnect=True)


async def test_where_it_is_looked_for() -> None:
    named = parse_source("ttyUSB0")
    places = Places(named)
    await places.begin()
    assert named in await places.candidates()
    wait_for_guard("ttyUSB0")


def test_names_stay_what_they_are_where_they_cannot_be_followed(tmp_path: Path) -> None:
    assert real_path("ttyUSB0") == "ttyUSB0"
    (tmp_path / "lidar").symlink_to("/dev/null")
    assert real_path(str(tmp_path / "lidar")) == "/dev/null"
