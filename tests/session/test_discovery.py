"""The ports of this machine, as the system's own list has them."""

import threading
from dataclasses import dataclass
from pathlib import Path

import pytest

from lidario import ConnectFailed, DeviceInfo, list_serial_ports
from lidario.basics.source import parse_source
from lidario.families.adapters import ADAPTERS
from lidario.session.finding.discovery import Found, PortInfo, find_source
from tests.support.refused import refused


@dataclass
class Port:
    device: str
    vid: int | None
    pid: int | None
    description: str = "n/a"


NUMBERS = {
    "CP2102": (0x10C4, 0xEA60, 1_000_000),
    "CH340": (0x1A86, 0x7523, 2_000_000),
    "CH9102": (0x1A86, 0x55D4, 4_000_000),
    "STM32 virtual port": (0x0483, 0x5740, 0),
    "PL2303": (0x067B, 0x2303, 6_000_000),
    "FT232": (0x0403, 0x6001, 3_000_000),
    "FT231X": (0x0403, 0x6015, 3_000_000),
}
"""As the drivers of Linux know them, and the speeds of the makers' data sheets."""


def test_adapters_have_the_speeds_of_their_data_sheets() -> None:
    assert {name: (each.vendor, each.product, each.fastest) for name, each in ADAPTERS.items()} == NUMBERS


def test_an_adapter_is_told_by_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [Port(f"/dev/ttyUSB{at}", *numbers[:2]) for at, numbers in enumerate(NUMBERS.values())]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)
    assert [port.adapter for port in list_serial_ports()] == [*NUMBERS]


def test_known_adapters_and_stable_names_are_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    device.touch()
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    (by_id / "usb-Silicon_Labs_CP2102").symlink_to(device)
    listed = [
        Port("/dev/ttyS0", None, None),
        Port(str(device), 0x10C4, 0xEA60, "CP2102 USB to UART"),
        Port("/dev/ttyACM0", 0x2341, 0x0043, "Arduino Uno"),
    ]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: listed)
    monkeypatch.setattr("lidario.session.finding.discovery.BY_ID", by_id)
    found = {port.path: port for port in list_serial_ports()}
    assert list(found) == sorted(port.device for port in listed)
    assert found[str(device)].adapter == "CP2102"
    assert found[str(device)].by_id == str(by_id / "usb-Silicon_Labs_CP2102")
    assert found["/dev/ttyACM0"].adapter == ""
    assert found["/dev/ttyACM0"].description == "Arduino Uno"
    assert (found["/dev/ttyS0"].adapter, found["/dev/ttyS0"].by_id, found["/dev/ttyS0"].description) == ("", "", "")


def test_ports_of_which_one_is_unplugged_meanwhile_are_listed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """pyserial takes the number of an adapter out of a file, which is gone by then. If it always is, it ends."""
    lists, fails = 0, 1

    def listed() -> list[Port]:
        nonlocal lists
        lists += 1
        return [Port("/dev/ttyUSB0", int(None, 16), 0)] if lists <= fails else [Port("/dev/ttyS0", None, None)]  # type: ignore[call-overload]

    monkeypatch.setattr("serial.tools.list_ports.comports", listed)
    monkeypatch.setattr("lidario.session.finding.discovery.LIST_AGAIN_S", 0.0)
    assert [port.path for port in list_serial_ports()] == ["/dev/ttyS0"]
    assert lists == 2
    fails = 10**9
    with pytest.raises(TypeError, match="non-string"):
        list_serial_ports()


def test_stable_names_are_unplugged_while_they_are_read(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The system removes their folder with the last of them."""
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [Port("/dev/ttyS0", None, None)])
    monkeypatch.setattr("lidario.session.finding.discovery.BY_ID", tmp_path / "gone")
    monkeypatch.setattr(Path, "is_dir", lambda _: True)
    assert [port.by_id for port in list_serial_ports()] == [""]


async def test_ports_are_listed_off_the_event_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    threads: list[threading.Thread] = []

    def ports() -> list[PortInfo]:
        threads.append(threading.current_thread())
        return []

    monkeypatch.setattr("lidario.session.finding.discovery.list_serial_ports", ports)
    with pytest.raises(ConnectFailed, match="no lidar found"):
        await find_source(parse_source("auto"))
    assert len(threads) == 2
    assert threading.current_thread() not in threads


async def test_a_family_chooses_among_the_lidars_that_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    infos = [DeviceInfo(family, "", 0, "1.0", 1, family) for family in ("rplidar", "ydlidar")]

    async def ask(*_: object) -> list[Found]:
        return [Found(PortInfo(f"/dev/{info.family}", "", "", ""), info, 115200, "") for info in infos]

    monkeypatch.setattr("lidario.session.finding.discovery.ask", ask)
    assert (await find_source(parse_source("auto"), "ydlidar")).address == "/dev/ydlidar"
    assert (await find_source(parse_source("id:rplidar"), "rplidar")).address == "/dev/rplidar"
    with pytest.raises(ConnectFailed, match="2 lidars respond"):
        await find_source(parse_source("auto"))
    for text in ("auto", "id:rplidar"):
        with refused("missing", "no lidar of the family 'ldrobot'"):
            await find_source(parse_source(text), "ldrobot")
