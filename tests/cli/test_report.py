"""``lidario report``: a page and a file, whatever becomes of the device meanwhile."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

import lidario
from lidario.conformance import RULES, Outcome, read_report
from tests.cli.processes import BOUND, invoke, invoke_driven, run, served, started
from tests.cli.test_ending import requests, stopped
from tests.support.children import until

LD19 = "sim://ldrobot-ld19?via=memory"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "report.mcap"


def test_a_report_is_a_page_and_a_file(path: Path) -> None:
    result = invoke_driven("report", LD19, "-o", str(path))
    assert result.exit_code == 0, result.stderr
    assert result.stderr.startswith("The report will hold every byte")
    assert "The serial number is hashed" in result.stderr
    assert f"wrote {path} (0." in result.stderr
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["lidar", "LDROBOT", "LD06,", "LD19", "or", "alike"]
    told = {
        line.split("  ")[0] + "/" + line.split()[1 if line.startswith("held") else 2]
        for line in lines
        if "-" in line
    }
    assert {"held/sample-time", "not tried/reset-boots"} <= told
    report = read_report(path)
    counts = {outcome: len(report.with_outcome(outcome)) for outcome in Outcome}
    assert lines[-1].strip() == ", ".join(f"{count} {outcome.value}" for outcome, count in counts.items())
    assert sum(counts.values()) == len(RULES)
    # Every other command reads it.
    assert invoke("info", str(path)).exit_code == 0


def test_a_report_is_checked(path: Path) -> None:
    assert invoke_driven("report", LD19, "-o", str(path)).exit_code == 0
    result = invoke_driven("report", "--check", str(path))
    assert result.exit_code == 0, result.stderr
    assert "new      nothing: all of it is known" in result.stdout
    assert "note: it is of a simulated device" in result.stderr
    page = json.loads(invoke_driven("report", "--check", str(path), "--json").stdout)
    assert page["info"]["model"] == "LDROBOT LD06, LD19 or alike"
    assert [each["rule"] for each in page["tried"]] == [rule.name for rule in RULES]
    assert page["facts"]["line"] == "simulated, 230400 baud"


def test_a_sick_device(path: Path) -> None:
    result = invoke_driven("report", LD19 + "&fault=flip:0.2%", "-o", str(path), "--json")
    assert result.exit_code == 0, result.stderr
    tried = {each["rule"]: each for each in json.loads(result.stdout)["tried"]}
    assert tried["packets-are-whole"]["outcome"] == "not held"
    # Samples that are missing do not make the others slower.
    assert tried["sample-time"]["outcome"] == "not tried"
    assert "skipped_bytes" in tried["packets-are-whole"]["text"]


def test_ctrl_c_leaves_what_was_tried(path: Path) -> None:
    with served("rplidar-s2") as server:
        with started("report", server.path, "-o", str(path)) as process:
            # The first rules only ask; all of them take half a minute.
            until(lambda: any("scan" in each.name for each in requests(server)))
            process.send_signal(signal.SIGINT)
            stdout, stderr = process.communicate(timeout=BOUND)
        assert process.returncode == 130, stderr
        until(lambda: stopped(server))
    assert f"wrote {path}" in stderr
    assert server.path not in stdout
    report = read_report(path)
    assert not report.is_complete
    assert report.tried[0].outcome is Outcome.HELD
    assert report.facts["adapter"] == "none: a pseudo-terminal"
    assert "the report was ended before" in stdout
    assert "note: it was ended before" in run("report", "--check", str(path)).stderr


def test_a_device_that_is_lost_meanwhile(path: Path) -> None:
    result = invoke_driven("report", "sim://rplidar-s2?via=memory&fault=unplug:3s", "-o", str(path))
    assert result.exit_code == 0, result.stderr
    report = read_report(path)
    assert "the line to the device is lost" in {each.text for each in report.tried}
    assert report.tried[0].outcome is Outcome.HELD


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("/dev/ttyNONE9",), 3, "no such port: '/dev/ttyNONE9'"),
        (("run.mcap",), 2, "rules are tried on a device"),
        (("--check", "missing.mcap"), 7, "missing.mcap"),
        (("--check", __file__), 7, "is no report"),
    ],
)
def test_where_there_is_nothing_to_try_no_file_is_made(
    arguments: tuple[str, ...], code: int, said: str, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(path.parent)
    result = invoke("report", *arguments)
    assert result.exit_code == code, result.stderr
    assert said in result.stderr
    assert not list(path.parent.iterdir())


def test_a_file_that_is_there_is_refused_before_the_device_is_touched(path: Path) -> None:
    path.write_bytes(b"mine")
    device = lidario.simulate("ldrobot-ld19")
    result = invoke("report", LD19, "-o", str(path))
    assert result.exit_code == 2
    assert "--force" in result.stderr
    assert path.read_bytes() == b"mine"
    assert not device.log
    assert invoke("report", LD19, "-o", str(path.with_suffix(".txt"))).exit_code == 2
