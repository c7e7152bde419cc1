"""``lidario devices``, and the command without a verb."""

import json

import pytest

import lidario
from tests.cli.processes import invoke, served

PORTS = [
    lidario.PortInfo("/dev/ttyUSB0", "/dev/serial/by-id/usb-a", "CP2102", "CP2102 bridge"),
    lidario.PortInfo("/dev/ttyUSB1", "", "CH340", ""),
    lidario.PortInfo("/dev/ttyS0", "", "", "built in"),
]
INFO = lidario.DeviceInfo("somefamily", "Model X1", 17, "1.29", 18, "00FF[0a]")
ANSWERS = lidario.Found(PORTS[0], INFO, 256000, "")
SILENT = lidario.Found(PORTS[1], None, 0, "/dev/ttyUSB1 opened, but nothing responds")


def found(monkeypatch: pytest.MonkeyPatch, *answers: lidario.Found) -> None:
    async def list_lidars(paths: tuple[str, ...] = ()) -> list[lidario.Found]:
        return list(answers)

    monkeypatch.setattr("lidario.list_lidars", list_lidars)
    monkeypatch.setattr("lidario.list_serial_ports", lambda: PORTS)


def test_a_table_for_people(monkeypatch: pytest.MonkeyPatch) -> None:
    found(monkeypatch, ANSWERS, SILENT)
    ended = invoke("devices", code=0)
    row = next(line for line in ended.stdout.splitlines() if "/dev/ttyUSB0" in line)
    for cell in ("Model X1", "00FF[0a]", "1.29", "256000", "CP2102"):
        assert cell in row
    assert SILENT.error in ended.stdout
    assert "/dev/ttyS0" in ended.stdout


def test_a_list_for_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    found(monkeypatch, ANSWERS, SILENT)
    ended = invoke("devices", "--json", code=0)
    assert ended.stderr == ""
    first, second, third = json.loads(ended.stdout)
    assert (first["port"], first["by_id"], first["baudrate"]) == ("/dev/ttyUSB0", "/dev/serial/by-id/usb-a", 256000)
    assert (first["model"], first["serial"], first["error"]) == ("Model X1", "00FF[0a]", None)
    assert (second["port"], second["model"], second["error"]) == ("/dev/ttyUSB1", None, SILENT.error)
    assert (third["port"], third["asked"]) == ("/dev/ttyS0", False)
    assert first.keys() == second.keys() == third.keys()


@pytest.mark.parametrize(
    ("reason", "code"), [("missing", 3), ("permission", 4), ("busy", 4), ("silent", 5), ("refused", 3)]
)
def test_a_named_port_ends_it_as_it_ends_scan(
    monkeypatch: pytest.MonkeyPatch, reason: lidario.ConnectReason, code: int
) -> None:
    found(monkeypatch, lidario.Found(PORTS[1], None, 0, "it cannot be opened", reason))
    assert invoke("devices", "/dev/ttyUSB1").exit_code == code
    # Where none is named, there is no device.
    assert invoke("devices").exit_code == 3


@pytest.mark.long
def test_a_named_port_is_asked() -> None:
    with served("rplidar-s2") as server:
        ended = invoke("devices", server.path, "/dev/nosuchport", "--json", code=0)
    device, missing = json.loads(ended.stdout)
    assert device["port"] == server.path
    assert device["baudrate"] == server.device.baudrate
    assert device["error"] is None
    assert missing["model"] is None
    assert "/dev/nosuchport" in missing["error"]


def test_without_a_verb_it_says_what_to_type_next(monkeypatch: pytest.MonkeyPatch) -> None:
    found(monkeypatch, ANSWERS)
    ended = invoke(code=0)
    assert "Model X1" in ended.stdout
    assert "lidario scan" in ended.stderr
    found(monkeypatch, ANSWERS, lidario.Found(PORTS[1], INFO, 115200, ""))
    assert "lidario scan /dev/ttyUSB0" in invoke().stderr
    found(monkeypatch)
    ended = invoke(code=3)
    assert "lidario scan sim://" in ended.stderr
