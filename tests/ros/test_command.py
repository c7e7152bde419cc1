"""`lidario publish` and `lidario devices --zenoh` without a network."""

import sys

import pytest

from tests.cli.processes import invoke

SIM = "sim://rplidar-s2?via=memory"


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
