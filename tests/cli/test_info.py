"""``lidario info``."""

import json

import pytest

from lidario.cli.output import console, rendered, table
from tests.cli.processes import in_memory, invoke, invoke_driven, served
from tests.support.samples import every_model


def test_everything_a_device_says_of_itself() -> None:
    serial = "000102030405060708090A0B0C0D0E0F"
    ended = invoke_driven("info", f"sim://rplidar-s2?via=memory&serial={serial}", "--json", code=0)
    told = json.loads(ended.stdout)
    assert told["serial"] == serial
    assert told["model_id"] == 0x71
    assert told["firmware"] == "1.02"
    assert told["health"] == {"status": "ok", "code": 0}
    assert told["scan_frequency"] == 10.0
    dense = next(mode for mode in told["modes"] if mode["name"] == "DenseBoost")
    assert (dense["id"], dense["sample_us"], dense["samples_per_second"]) == (1, 31.25, 32000.0)
    assert (dense["max_distance"], dense["response_type"], dense["typical"]) == (30.0, 0x85, True)


def test_for_people() -> None:
    ended = invoke_driven("info", "sim://rplidar-s2?via=memory", code=0)
    row = next(line for line in ended.stdout.splitlines() if "DenseBoost" in line)
    assert row.split() == ["1", "DenseBoost", "31.25", "32000", "30", "m", "0x85", "yes"]
    assert max(map(len, ended.stdout.splitlines())) <= 80


@pytest.mark.parametrize("columns", [20, 40, 79])
def test_on_a_narrow_terminal_no_word_of_a_table_is_folded(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    made = table(("id", "scan mode", "typical"), [("0", "Standard", ""), ("1", "Boost", "yes")])
    told = " ".join(rendered(console(), made).split())
    assert told == "id 0 scan mode Standard id 1 scan mode Boost typical yes"


def test_what_a_device_does_not_tell_has_no_line() -> None:
    ended = invoke_driven("info", "sim://ldrobot-ld06?via=memory")
    words = [line.split()[0] for line in ended.stdout.splitlines() if line.strip()]
    assert words[:3] == ["source", "model", "health"]
    assert "number" not in ended.stdout
    assert all(word not in words for word in ("firmware", "hardware", "serial"))


def test_a_frequency_that_can_be_set_and_not_read() -> None:
    """Of the LD14P; `lidario motor speed` sets it."""
    told = json.loads(invoke_driven("info", "sim://ldrobot-ld14p?via=memory", "--json").stdout)
    assert (told["scan_frequency"], told["scan_frequency_range"]) == (None, [2.0, 8.0])
    assert "not told, from 2 to 8 Hz" in invoke_driven("info", "sim://ldrobot-ld14p?via=memory").stdout
    assert "cannot be set" in invoke_driven("info", "sim://ldrobot-ld06?via=memory").stdout


@every_model()
def test_every_model(model: str) -> None:
    ended = invoke_driven("info", in_memory(model), "--json", code=0)
    told = json.loads(ended.stdout)
    assert told["model"]
    assert len(told["modes"]) >= 1
    assert sum(mode["typical"] for mode in told["modes"]) == 1
    assert invoke_driven("info", in_memory(model)).exit_code == 0


@pytest.mark.long
def test_a_device_that_protects_itself_is_unhealthy() -> None:
    with served("ydlidar-4ros") as server:
        with server.lock:
            server.device.health = (2, 0x1234)  # type: ignore[attr-defined]
            server.device.faults_cleared_by_reset = False  # type: ignore[attr-defined]
        ended = invoke("info", server.path, "--json", code=6)
    assert ended.stdout == ""
    assert ended.stderr.startswith("error: ")
