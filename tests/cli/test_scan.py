"""``lidario scan``: what it prints, for people and for programs."""

import csv
import io
import json
import math
from collections import Counter

import numpy as np
import pytest

from lidario.cli.formats import CSV_HEADER, as_csv
from tests.cli.processes import in_memory, invoke_driven
from tests.support.samples import every_model
from tests.support.sweep import sweep

CIRCLE = "sim://rplidar-s2?via=memory&world=circle"


def test_json_lines_of_a_circle() -> None:
    ended = invoke_driven("scan", CIRCLE, "-n", "3", "--json", code=0)
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


def test_intensities_where_the_mode_carries_them() -> None:
    ended = invoke_driven("scan", CIRCLE, "--mode", "0", "--json")
    (scan,) = map(json.loads, ended.stdout.splitlines())
    assert scan["mode"] == "Standard"
    assert len(scan["intensities"]) == len(scan["ranges"])
    assert all(isinstance(value, int) for value in scan["intensities"])


@pytest.mark.long
def test_csv_is_one_row_per_sample() -> None:
    source = "sim://rplidar-s2?via=memory"
    ended = invoke_driven("scan", source, "-n", "2", "--csv", code=0)
    rows = list(csv.DictReader(io.StringIO(ended.stdout)))
    assert list(rows[0]) == ["seq", "wall_stamp_ns", "angle_rad", "range_m", "intensity"]
    # The clock is driven, so that a second run brings the same scans.
    again = invoke_driven("scan", source, "-n", "2", "--json").stdout.splitlines()
    lengths = {str(scan["seq"]): len(scan["ranges"]) for scan in map(json.loads, again)}
    assert lengths.keys() == {"0", "1"}
    assert sum(lengths.values()) > 6000
    assert Counter(row["seq"] for row in rows) == lengths
    for seq in lengths:
        stamps = [int(row["wall_stamp_ns"]) for row in rows if row["seq"] == seq]
        assert stamps == sorted(stamps)
    missing = [row for row in rows if not row["range_m"]]
    assert 0 < len(missing) < len(rows) / 10  # the beams through the open door
    assert all(0.1 < float(row["range_m"]) < 30 for row in rows if row["range_m"])


def test_people_get_a_line_a_scan_and_a_picture() -> None:
    ended = invoke_driven("scan", CIRCLE, "-n", "2", code=0)
    header, first, second, *picture = ended.stdout.splitlines()
    assert header.split() == ["scan", "samples", "returns", "rpm", "Hz", "nearest", "farthest", "lost", "dropped"]
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


@every_model()
def test_every_model(model: str) -> None:
    ended = invoke_driven("scan", in_memory(model, "world=circle"), "--json")
    assert (ended.exit_code, ended.stderr) == (0, "")
    scan = json.loads(ended.stdout)
    assert len(scan["ranges"]) >= 200
    assert all(value is not None and abs(value - 2.0) < 0.02 for value in scan["ranges"])


@pytest.mark.long
def test_a_device_that_is_unplugged_is_lost_but_counted() -> None:
    ended = invoke_driven("scan", "sim://rplidar-s2?via=memory&fault=unplug:3s", "-n", "0", "--json", code=5)
    scans = [json.loads(line) for line in ended.stdout.splitlines()]
    assert scans
    assert f"{len(scans)} scan" in ended.stderr
    assert ended.stderr.splitlines()[-1].startswith("error: ")


@pytest.mark.long
def test_it_goes_on_after_the_lidar_was_unplugged() -> None:
    source = "sim://rplidar-s2?via=memory&fault=replug:2s"
    result = invoke_driven("scan", source, "-n", "15", "--json", "--reconnect", code=0)
    numbers = [json.loads(line)["seq"] for line in result.stdout.splitlines()]
    assert len(numbers) == 15
    assert numbers[-1] > 20
    assert "1 reconnect" in result.stderr


@pytest.mark.long
def test_what_a_device_does_not_tell_is_left_out() -> None:
    """A device that only talks tells no serial number and no firmware."""
    for verb in (["scan"], ["stats", "-t", "1s"], ["doctor"]):
        ended = invoke_driven(*verb, "sim://ldrobot-ld06?via=memory")
        said = ended.stdout + ended.stderr
        assert ended.exit_code in (0, 5), said
        assert "LDROBOT LD06" in said
        assert "serial number" not in said, verb
        assert "firmware" not in said, verb


def test_csv_tells_when_a_sample_behind_a_gap_was_measured() -> None:
    truth = sweep(hertz=10, sample_us=500, gaps=[(0.25, 0.05)])
    rows = csv.DictReader(io.StringIO(CSV_HEADER + as_csv(truth.scan)))
    told = np.array([int(row["wall_stamp_ns"]) for row in rows])
    measured = np.array([truth.wall_ns[number] for number in truth.kept])
    assert len(told) == len(measured) == 190
    assert np.abs(told - measured).max() < 1000
