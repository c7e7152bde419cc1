"""The network address of an Ethernet model."""

import struct
from typing import Any

import pytest

from benchmarks.relayed import Relayed
from lidario import InvalidValue, NetworkAddress, RemoteProtocolError, Unsupported, open_lidar
from lidario.families.rplidar.commands import Conf, get_lidar_conf, set_lidar_conf
from tests.support.devices import Rig, make_rig, names
from tests.support.rplidar_device import S2, identified
from tests.support.scripts import drive

ADDRESS = NetworkAddress("192.168.11.3", "255.255.255.0", "192.168.11.1")
BYTES = bytes([192, 168, 11, 3, 255, 255, 255, 0, 192, 168, 11, 1])
TYPE = struct.pack("<I", 0x1CCC0)
ASK = bytes.fromhex("a58406c0cc010000002a")


def test_the_documented_request() -> None:
    assert get_lidar_conf(Conf.NETWORK_ADDRESS, 0).data == ASK
    told, _ = drive(identified(S2).network_address(), {ASK: TYPE + BYTES})
    assert told == ADDRESS


@pytest.mark.parametrize("response", [None, TYPE, TYPE + BYTES[:11]])
def test_a_device_without_one(response: bytes | None) -> None:
    with pytest.raises(Unsupported, match="Ethernet"):
        drive(identified(S2).network_address(), {ASK: response})


def test_setting_it() -> None:
    request = set_lidar_conf(Conf.NETWORK_ADDRESS, BYTES).data
    assert request[:3] == b"\xa5\x85\x10"
    drive(identified(S2).set_network_address(ADDRESS), {request: TYPE + bytes(4)})
    # The address zero means DHCP.
    dhcp = set_lidar_conf(Conf.NETWORK_ADDRESS, bytes(12)).data
    drive(identified(S2).set_network_address(NetworkAddress("0.0.0.0")), {dhcp: TYPE + bytes(4)})
    with pytest.raises(RemoteProtocolError, match="0x80008001"):
        drive(identified(S2).set_network_address(ADDRESS), {request: TYPE + bytes.fromhex("01800080")})
    with pytest.raises(Unsupported, match="Ethernet"):
        drive(identified(S2).set_network_address(ADDRESS), {})


@pytest.mark.parametrize(
    "wrong",
    [
        *(NetworkAddress("192.168.11"), NetworkAddress("::1"), NetworkAddress("192.168.11.3", gateway="")),
        NetworkAddress(3232238339),  # type: ignore[arg-type]
        *("192.168.11.3", None),
    ],
)
def test_what_is_no_address_is_refused_before_anything_is_sent(wrong: Any) -> None:
    with pytest.raises(InvalidValue, match="address"):
        next(identified(S2).set_network_address(wrong))


@pytest.mark.parametrize("rig", ["rplidar-s2e"], indirect=True)
async def test_it_is_in_force_after_a_reset(rig: Rig) -> None:
    async with rig.read() as (lidar, stream):
        await lidar.set_network_address(ADDRESS)
        assert (await lidar.get_network_address()).address == "0.0.0.0"
        await anext(stream)
        await lidar.reset()
        assert await lidar.get_network_address() == ADDRESS
    assert "set_lidar_conf" in names(rig)


@pytest.mark.parametrize(
    ("rig", "name", "again"),
    [("rplidar-s2e", "RPLIDAR S2E", 0), ("rplidar-s2", "RPLIDAR S2M1", 1)],
    indirect=["rig"],
)
async def test_an_s2_with_an_ethernet_address_is_an_s2e(rig: Rig, name: str, again: int) -> None:
    """It is asked for that only where the line has no speed: a serial S2 would not respond."""
    async with open_lidar(Bridged(rig.device), family="rplidar") as lidar:
        asked = names(rig).count("get_lidar_conf")
        assert lidar.info.model == name
        assert (await lidar.get_info()).model == name
        assert names(rig).count("get_lidar_conf") == asked + again


async def test_an_s2e_whose_ethernet_address_was_lost_on_the_way_is_one_as_soon_as_it_tells_it() -> None:
    rig = make_rig("rplidar-s2e")
    receive = rig.device.receive
    rig.device.receive = lambda data, now: None if data[1:2] == b"\x84" else receive(data, now)
    async with open_lidar(Bridged(rig.device), family="rplidar") as lidar:
        assert lidar.info.model == "RPLIDAR S2M1"
        rig.device.receive = receive
        assert (await lidar.get_info()).model == "RPLIDAR S2E"
        assert lidar.info.model == "RPLIDAR S2E"


class Bridged(Relayed):
    """A device behind a network: its line has no speed."""

    @property
    def baudrate(self) -> int:
        """None."""
        return 0
