"""What ``lidario doctor`` says of the line to a lidar on a pseudo-terminal."""

import json
from pathlib import Path

import pytest

import lidario
from lidario.cli.machine import Machine
from tests.cli.processes import invoke
from tests.support.drivers import SPEED_FLAG, FakeDriver
from tests.support.terminals import WaitingPtyServer


@pytest.mark.long
@pytest.mark.parametrize("refuses", [False, True])
def test_what_low_latency_has_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refuses: bool) -> None:
    with WaitingPtyServer(lidario.simulate("rplidar-s2")) as server:
        port = lidario.PortInfo(server.path, "", "FT232", "FT232R USB UART")
        driver = FakeDriver(server.path, monkeypatch, tmp_path)
        driver.fails = refuses
        monkeypatch.setattr("lidario.cli.doctor.Machine", lambda: Machine(tmp_path))
        monkeypatch.setattr("lidario.list_serial_ports", lambda: [port])
        ended = invoke("doctor", server.path, "--json", code=0)
    (found,) = [each for each in json.loads(ended.stdout) if each["what"] == "latency"]
    if refuses:
        assert (found["state"], "16 ms" in found["text"]) == ("hint", True)
        assert "lidario udev" in found["cure"]
    else:
        assert found["text"] == "the adapter gathers bytes for 1 ms while lidario has it open, else for 16 ms"
        assert (found["state"], found["port"]) == ("ok", server.path)
        assert driver.flags == SPEED_FLAG
