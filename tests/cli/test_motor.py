"""``lidario motor``: what the device does afterwards."""

import json

import pytest

from lidario.families.registry import FAMILIES
from tests.cli.processes import end, invoke, invoke_driven, served, started
from tests.support.children import is_still, requests, until

FIRST, SECOND = (family.simulated[0] for family in FAMILIES[:2])


@pytest.mark.long
def test_start_leaves_the_motor_on_and_the_laser_off_and_stop_ends_it() -> None:
    with served(FIRST) as server:
        ended = invoke("motor", "start", server.path, "--json", code=0)
        assert json.loads(ended.stdout)["motor"] == "turning"
        until(lambda: not server.device.scanning)
        assert server.device.motor_on
        assert invoke("motor", "stop", server.path).exit_code == 0
        until(lambda: not server.device.motor_on)


@pytest.mark.long
def test_speed_is_measured_where_the_motor_turns_alone() -> None:
    with served(FIRST) as server:
        ended = invoke("motor", "speed", "12", server.path, "--json", code=0)
        told = json.loads(ended.stdout)
        assert told["motor"] == "turning"
        assert told["hertz"] == pytest.approx(12, rel=0.05)
        until(lambda: not server.device.scanning)
        assert server.device.motor_on


@pytest.mark.long
def test_what_is_refused_or_interrupted_leaves_the_motor_off() -> None:
    with served(FIRST) as server:
        ended = invoke("motor", "speed", "100", server.path, code=2)
        assert "is outside of this device's" in ended.stderr
        assert requests(server)
        until(lambda: is_still(server))
        server.device.spin_up_s = 60.0  # type: ignore[attr-defined]
        with started("motor", "start", server.path) as process:
            until(lambda: server.device.motor_on)
            end(process)
        assert process.returncode == 130
        until(lambda: is_still(server))


@pytest.mark.long
def test_where_the_motor_stops_with_the_laser() -> None:
    with served(SECOND) as server:
        ended = invoke("motor", "start", server.path, code=2)
        assert "lidario scan -n 0" in ended.stderr
        ended = invoke("motor", "speed", "9", server.path, "--json", code=0)
        assert json.loads(ended.stdout) == {"motor": "set", "hertz": 9.0}
        assert not server.device.motor_on


@pytest.mark.parametrize("model", ["ldrobot-ld06", "ydlidar-x3"])
def test_a_motor_that_cannot_be_stopped_is_not_called_stopped(model: str, caplog: pytest.LogCaptureFixture) -> None:
    for words, says in ((["stop"], "error: nothing was stopped"), (["speed", "7"], "cannot be set from here")):
        caplog.clear()
        ended = invoke_driven("motor", *words, f"sim://{model}?via=memory")
        assert (ended.exit_code, ended.stdout) == (2, ""), words
        assert says in ended.stderr
        # What is logged stands on the same screen.
        assert (caplog.text + ended.stderr).count("cannot be stopped from here") == 1


def test_the_motor_of_a_model_that_only_talks_is_stopped_by_dtr_where_that_is_its_switch() -> None:
    ended = invoke_driven("motor", "stop", "sim://ydlidar-x2?via=memory")
    assert (ended.exit_code, ended.stdout, ended.stderr) == (0, "laser and motor are off\n", "")
