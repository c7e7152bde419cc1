"""``lidario scan``: what it prints, for people and for programs."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math

import pytest

from lidario.families.registry import FAMILIES
from tests.cli.processes import BOUND, invoke, started

MODELS = [model for family in FAMILIES for model in family.simulated]
CIRCLE = "sim://rplidar-s2?via=memory&world=circle"


def test_json_lines_of_a_circle() -> None:
    ended = invoke("scan", CIRCLE, "-n", "3", "--json")
    assert ended.exit_code == 0
    scans = [json.loads(line, parse_constant=pytest.fail) for line in ended.stdout.splitlines()]
    assert [scan["seq"] for scan in scans] == [0, 1, 2]
    for scan in scans:
        assert len(scan["angles"]) == len(scan["ranges"]) > 3000
        assert scan["ranges"] == [2.0] * len(scan["ranges"])
        assert all(-math.pi <= angle <= math.pi for angle in scan["angles"])
        assert scan["mode"] == "DenseBoost"
        assert scan["intensities"] is None
        assert scan["time_increment_ns"] == 31250
        assert scan["rpm"] == pytest.approx(600, rel=0.05)
        assert (scan["lost_packets"], scan["dropped_before"]) == (0, 0)
    assert scans[0]["stamp_ns"] < scans[1]["stamp_ns"] < scans[2]["stamp_ns"]


def test_json_says_null_where_nothing_came_back() -> None:
    ended = invoke("scan", "sim://rplidar-s2?via=memory&world=empty", "--json")
    assert ended.exit_code == 0
    (scan,) = map(json.loads, ended.stdout.splitlines())
    assert set(scan["ranges"]) == {None}


def test_intensities_where_the_mode_carries_them() -> None:
    ended = invoke("scan", CIRCLE, "--mode", "standard", "--json")
    (scan,) = map(json.loads, ended.stdout.splitlines())
    assert len(scan["intensities"]) == len(scan["ranges"])
    assert all(isinstance(value, int) for value in scan["intensities"])


def test_a_mode_by_its_id() -> None:
    ended = invoke("scan", CIRCLE, "--mode", "0", "--json")
    assert json.loads(ended.stdout)["mode"] == "Standard"


def test_csv_is_one_row_per_sample() -> None:
    ended = invoke("scan", "sim://rplidar-s2?via=memory", "-n", "2", "--csv")
    assert ended.exit_code == 0
    rows = list(csv.DictReader(io.StringIO(ended.stdout)))
    assert list(rows[0]) == ["seq", "wall_stamp_ns", "angle_rad", "range_m", "intensity"]
    assert {row["seq"] for row in rows} == {"0", "1"}
    assert len(rows) > 6000
    for seq in ("0", "1"):
        stamps = [int(row["wall_stamp_ns"]) for row in rows if row["seq"] == seq]
        assert stamps == sorted(stamps)
    missing = [row for row in rows if not row["range_m"]]
    assert 0 < len(missing) < len(rows) / 10  # the beams through the open door
    assert all(0.1 < float(row["range_m"]) < 30 for row in rows if row["range_m"])


def test_people_get_a_line_a_scan_and_a_picture() -> None:
    ended = invoke("scan", CIRCLE, "-n", "2")
    assert ended.exit_code == 0
    header, first, second, *picture = ended.stdout.splitlines()
    assert header.split() == ["scan", "points", "returns", "rpm", "Hz", "nearest", "farthest", "lost", "dropped"]
    assert first.split()[0] == "0"
    assert second.split()[0] == "1"
    for line in (first, second):
        assert "100.0%" in line
        assert line.count("2.00 m") == 2
    assert max(map(len, ended.stdout.splitlines())) <= 80
    assert any("▲" in line for line in picture)
    assert any(0x2800 < ord(character) < 0x2900 for line in picture for character in line)
    assert "\x1b" not in ended.stdout
    assert "2 scans in" in ended.stderr


def test_nothing_to_draw() -> None:
    ended = invoke("scan", "sim://rplidar-s2?via=memory&world=empty")
    assert ended.exit_code == 0
    assert "no returns" in ended.stdout


@pytest.fixture(scope="module")
def scanned() -> dict[str, tuple[int | None, str, str]]:
    """Exit code, stdout and stderr for a scan of every model; all at once, since they mostly wait."""
    with contextlib.ExitStack() as stack:
        processes = {
            model: stack.enter_context(started("scan", f"sim://{model}?via=memory&world=circle", "--json"))
            for model in MODELS
        }
        said = {model: process.communicate(timeout=BOUND) for model, process in processes.items()}
        return {model: (processes[model].returncode, *said[model]) for model in MODELS}


@pytest.mark.parametrize("model", MODELS)
def test_every_model(scanned: dict[str, tuple[int | None, str, str]], model: str) -> None:
    code, out, said = scanned[model]
    assert (code, said) == (0, "")
    scan = json.loads(out)
    assert len(scan["ranges"]) >= 200
    assert all(value is not None and abs(value - 2.0) < 0.02 for value in scan["ranges"])


def test_a_device_that_is_unplugged_is_lost_but_counted() -> None:
    ended = invoke("scan", "sim://rplidar-s2?via=memory&fault=unplug:3s", "-n", "0", "--json")
    assert ended.exit_code == 5
    scans = [json.loads(line) for line in ended.stdout.splitlines()]
    assert scans
    assert f"{len(scans)} scan" in ended.stderr
    assert ended.stderr.splitlines()[-1].startswith("error: ")
