"""`lidario publish` and `lidario devices --zenoh` without a network."""

import sys

import pytest

from tests.cli.processes import invoke

SIM = "sim://rplidar-s2?via=memory"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "say one of --ros and --zenoh KEY"),
        (("--ros", "--zenoh", "a"), "say one of --ros and --zenoh KEY"),
        (("--ros", "--raw"), "--raw belongs to --zenoh KEY"),
        (("--zenoh", "a", "--frame", "x"), "--frame belongs to --ros"),
        (("--zenoh", "a", "--mount-yaw", "3"), "--mount-yaw belongs to --ros"),
        (("--zenoh", "a", "--mount", "0,0,0"), "--mount belongs to --ros"),
        (("--ros", "--stamps", "now"), "--stamps is for a recording"),
        (("--ros", "--mount", "0,0"), "is not x,y,yaw in metres and degrees"),
        (("--ros", "--idle-stop", "never"), "is not a duration"),
        ((SIM, "run.mcap", "--ros"), "a recording is of another time"),
        ((SIM, "--zenoh", "a"), "several lidars become one with --ros"),
        ((SIM, "--ros", "--mount", "0,0,0"), "2 lidars and 1 mount: once"),
        ((SIM, "--ros", "--mount-yaw", "3"), "--mount-yaw is for one lidar"),
        ((SIM, "--ros", "--frame", "x"), "--frame is for one lidar"),
    ],
)
def test_options_that_do_not_go_together(arguments: tuple[str, ...], words: str) -> None:
    done = invoke("publish", SIM, *arguments, code=2)
    assert words in done.stderr.replace("\n", " ")


@pytest.mark.parametrize("arguments", [("publish", SIM, "--ros"), ("devices", "--zenoh"), ("info", "zenoh:a")])
def test_a_missing_extra_is_one_sentence(arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zenoh", None)
    done = invoke(*arguments, code=2)
    assert done.stderr == ("error: zenoh needs eclipse-zenoh, which is not installed: pip install eclipse-zenoh\n")


@pytest.mark.parametrize("arguments", [("devices", "--zenoh"), ("info", "zenoh:a")])
def test_no_router_is_told_with_its_cure(arguments: tuple[str, ...]) -> None:
    address = "tcp/127.0.0.1:1"
    if arguments[0] == "info":
        done = invoke("info", f"zenoh:a?router={address}")
    else:
        done = invoke(*arguments, "--router", address, code=3)
    assert done.stderr.startswith(f"error: no zenoh router responds at {address}. Start one: lidario router")


def test_ports_and_the_network_are_two_questions() -> None:
    done = invoke("devices", "--zenoh", "/dev/ttyUSB0", code=2)
    assert "--zenoh asks no ports" in done.stderr
