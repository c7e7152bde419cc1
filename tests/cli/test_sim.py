"""``lidario sim``: a lidar for anybody's driver."""

import json
import re
import signal
import socket
from types import SimpleNamespace
from typing import cast

import pytest

from lidario import simulate
from lidario.basics.source import parse_source
from lidario.cli.sim import name_of, server_of, sum_up
from lidario.families.registry import FAMILIES
from lidario.sim.faults import FAULTS, Faults, parse_faults
from lidario.sim.serve import PtyServer
from tests.cli.processes import end, invoke, run, started
from tests.support.children import BOUND, line_of


def test_the_models_are_listed() -> None:
    listed = invoke("sim", "--list", code=0)
    lines = listed.stdout.splitlines()
    assert [line for line in lines if line[0] != " "] == [f"{family.title}:" for family in FAMILIES]
    models = [line.split(maxsplit=1) for line in lines if line[0] == " "]
    assert [name for name, *_ in models] == [model for family in FAMILIES for model in family.simulated]
    assert ["rplidar-a1", "115200 baud, Sensitivity 0x84 7874/s, motor by DTR; like an A1M8"] in models
    assert max(map(len, lines)) <= 100


def test_the_faults_are_listed() -> None:
    listed = invoke("sim", "--list-faults", code=0)
    words = [line.split()[0] for line in listed.stdout.splitlines()]
    assert [word.partition(":")[0] for word in words] == list(FAULTS)
    for word in words:
        assert parse_faults(word) != Faults()


@pytest.mark.long
def test_one_process_serves_and_another_scans() -> None:
    serial = "00112233445566778899AABBCCDDEEFF"
    with started("sim", "--pty", "--serial", serial, "--world", "circle") as sim:
        path = line_of(sim.stdout).strip()
        told = run("info", path, "--json")
        assert json.loads(told.stdout)["serial"] == serial
        scanned = run("scan", path, "-n", "2", "--json")
        assert scanned.returncode == 0, scanned.stderr
        first, second = (json.loads(line)["seq"] for line in scanned.stdout.splitlines())
        assert first < second
        rest, said = end(sim)
    assert sim.returncode == 0
    assert rest == ""
    assert f"lidario scan {path}" in said
    summary = said.partition("served")[2]
    assert "get_info" in summary
    assert "stop" in summary
    assert "left it scanning" not in summary


@pytest.mark.parametrize(
    ("model", "requests", "left"),
    [
        ("ldrobot-ld06", [b""], []),
        ("rplidar-s2", [b"\xa5\x20"], ["left it scanning"]),
        ("rplidar-s2", [b"\xa5\x20", b"\xa5\x25"], ["left its motor on"]),
        ("rplidar-s2", [b"\xa5\x20", b"\xa5\x25", b"\xa5\xa8\x02\x00\x00\x0f"], []),
    ],
    ids=["it only talks", "scanning", "stopped", "stopped with its motor"],
)
def test_how_a_client_has_left_it_is_told(
    model: str, requests: list[bytes], left: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    device = simulate(model)
    for second, data in enumerate(requests):
        device.receive(data, second * 10**9 + 1)
        device.transmit(second * 10**9 + 2)
    assert device.scanning is (len(requests) == 1)
    sum_up(cast("PtyServer", SimpleNamespace(device=device, lost=0)), 1.0)
    assert re.findall("left it.*", capsys.readouterr().err) == left


@pytest.mark.long
@pytest.mark.parametrize("model", ["rplidar-a1", "rplidar-c1-fixed"])
def test_no_client_has_left_a_motor_on_that_no_request_stops(model: str) -> None:
    """By DTR, which a pseudo-terminal and TCP do not carry; or never."""
    with started("sim", model, "--tcp", ":0") as sim:
        told = run("info", line_of(sim.stdout).strip())
        assert told.returncode == 0, told.stderr
        _, said = end(sim)
    assert "get_info" in said
    assert "left its motor on" not in said


@pytest.mark.parametrize("way", ["tcp", "udp"])
@pytest.mark.parametrize("address", ["[::1]:0", "::1:0"])
def test_an_ipv6_address_is_printed_as_a_client_opens_it(way: str, address: str) -> None:
    tcp, udp = (address, None) if way == "tcp" else (None, address)
    with server_of(simulate("ydlidar-4ros"), pty=False, tcp=tcp, udp=udp) as server:
        source = parse_source(name_of(server))
    assert not isinstance(server, PtyServer)
    assert (source.kind, source.host_and_port) == (way, server.address)
    assert server.address[0] == "::1"


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "way", "number"), [("ydlidar-4ros", "tcp", signal.SIGTERM), ("rplidar-s2e", "udp", signal.SIGINT)]
)
def test_over_a_network(model: str, way: str, number: signal.Signals) -> None:
    with started("sim", model, f"--{way}", ":0") as sim:
        address = line_of(sim.stdout).strip()
        assert address.startswith(f"{way}://127.0.0.1:")
        scanned = invoke("scan", address, "--json", code=0)
        assert json.loads(scanned.stdout)["ranges"]
        sim.send_signal(number)
        assert sim.wait(BOUND) == 0


def test_an_address_that_is_taken() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        ended = invoke("sim", "--tcp", f"127.0.0.1:{taken.getsockname()[1]}", code=4)
    assert ended.stdout == ""
    assert "in use" in ended.stderr


@pytest.mark.long
def test_it_ends_when_a_fault_pulls_the_cable() -> None:
    with started("sim", "--fault", "drop:0.1%", "--fault", "unplug:100ms") as sim:
        path = line_of(sim.stdout).strip()
        assert invoke("scan", path, "-n", "0").exit_code == 5
        assert sim.wait(BOUND) == 0


@pytest.mark.long
def test_after_a_replug_the_new_name_is_told() -> None:
    with started("sim", "--pty", "--fault", "replug:100ms") as sim:
        first = line_of(sim.stdout).strip()
        assert invoke("scan", first, "-n", "0").exit_code == 5
        second = line_of(sim.stdout).strip()
        assert second != first
        assert invoke("scan", second).exit_code == 0
        _, said = end(sim)
    assert sim.returncode == 0
    assert "plugged in again" in said
