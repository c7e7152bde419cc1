"""``lidario motor``: what the device does afterwards."""

import json
from typing import Any

import pytest
from click.testing import Result

from lidario import simulate
from lidario.families.registry import FAMILIES
from tests.cli.processes import end, invoke, invoke_driven, served, started
from tests.support.children import is_still, requests, until
from tests.support.devices import is_off, leave_streaming
from tests.support.loop import START

FIRST, SECOND = (family.simulated[0] for family in FAMILIES[:2])


@pytest.fixture
def device(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A simulated device in memory, which the command finds at any source of that kind."""
    made = simulate(getattr(request, "param", FIRST), spin_up=0)
    monkeypatch.setattr("lidario.port.simulated.make_device", lambda _: (made, None))
    return made


def motor(*words: str, model: str = FIRST, code: int = 0) -> Result:
    return invoke_driven("motor", *words, f"sim://{model}?via=memory", "--json", code=code)


def test_start_leaves_the_motor_on_and_the_laser_off(device: Any) -> None:
    assert json.loads(motor("start").stdout)["motor"] == "turning"
    assert (device.scanning, device.motor_on) == (False, True)


def test_stop_ends_what_an_earlier_program_has_left_running(device: Any) -> None:
    leave_streaming(device, round(START * 1e9))
    assert json.loads(motor("stop").stdout)["motor"] == "stopped"
    assert is_off(device)


def test_speed_is_measured_where_the_motor_turns_alone(device: Any) -> None:
    told = json.loads(motor("speed", "12").stdout)
    assert told == {"motor": "turning", "hertz": pytest.approx(12, rel=0.01)}
    assert (device.scanning, device.motor_on) == (False, True)


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


@pytest.mark.parametrize("device", [SECOND], indirect=True)
def test_where_the_motor_stops_with_the_laser(device: Any) -> None:
    assert "lidario scan -n 0" in motor("start", model=SECOND, code=2).stderr
    assert json.loads(motor("speed", "9", model=SECOND).stdout) == {"motor": "set", "hertz": 9.0}
    assert not device.motor_on


def test_a_motor_that_turns_while_it_has_power_is_not_called_stopped() -> None:
    """Of a device whose laser obeys: its motor was said to be off, and to stop with the laser."""
    for words, says in (
        (["stop"], "the laser is off; the motor of this device turns while it has power\n"),
        (["start"], "the motor turns at 40.00 Hz (2400 rpm)\n"),
    ):
        ended = invoke_driven("motor", *words, "sim://hokuyo-ust10lx?via=memory")
        assert (ended.exit_code, ended.stdout, ended.stderr) == (0, says, "")
    told = invoke_driven("motor", "stop", "sim://hokuyo-ust10lx?via=memory", "--json").stdout
    assert json.loads(told) == {"motor": "unstoppable", "hertz": None}


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
