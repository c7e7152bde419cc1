"""What a first user does wrong, and the words that say how it is done."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import lidario
from lidario.session.finding import discovery
from lidario.testing import make_scan
from tests.cli.processes import invoke, invoke_driven

S2 = "sim://rplidar-s2?via=memory"


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("devices", "sim://rplidar-s2"), 2, "is no port: `lidario info sim://rplidar-s2`"),
        (("scan", "sim:rplidar-s2"), 2, "two slashes, as in sim://rplidar-s2"),
        (("motor",), 2, "lidario motor start, lidario motor stop, lidario motor speed"),
    ],
)
def test_words_with_a_cure(arguments: tuple[str, ...], code: int, words: str) -> None:
    ended = invoke(*arguments)
    assert (ended.exit_code, ended.stdout) == (code, "")
    assert words in ended.stderr
    assert len(ended.stderr.splitlines()) <= 2


def test_without_a_lidar_a_simulated_one_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "list_serial_ports", list)
    for verb in ("scan", "info", "stats", "record", "plot"):
        ended = invoke(verb)
        assert ended.exit_code == 3
        assert "Without a lidar, a simulated one does: sim://rplidar-s2" in ended.stderr


def test_a_recording_that_is_there_is_replaced_by_force(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    for options, code in (((), 0), ((), 4), (("--force",), 0)):
        ended = invoke_driven("record", S2, "-o", str(path), "--time", "0.5s", *options)
        assert ended.exit_code == code
        assert ("overwrite=True, or --force, replaces it" in ended.stderr) is (code == 4)


def test_a_picture_that_is_there_is_replaced_by_force(tmp_path: Path) -> None:
    path = tmp_path / "scan.svg"
    path.write_text("mine")
    ended = invoke_driven("plot", S2, "-o", str(path))
    assert ended.exit_code == 4
    assert "--force replaces it" in ended.stderr
    assert path.read_text() == "mine"
    assert invoke_driven("plot", S2, "-o", str(path), "--force").exit_code == 0
    assert path.read_text().startswith("<svg")
    assert os.listdir(tmp_path) == ["scan.svg"]


def test_a_full_disk_leaves_the_picture_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scan.svg"
    path.write_text("mine")

    def half(self: Path, data: bytes) -> int:
        with open(self, "wb") as file:
            file.write(data[:100])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", half)
    ended = invoke_driven("plot", S2, "-o", str(path), "--force")
    assert ended.exit_code == 4
    assert "No space left on device" in ended.stderr
    assert path.read_text() == "mine"
    assert os.listdir(tmp_path) == ["scan.svg"]


@pytest.mark.long
@pytest.mark.parametrize(
    "arguments", [("info", S2), ("doctor",), ("stats", S2, "-t", "0.3s"), ("devices", "--json")]
)
def test_a_full_disk_behind_stdout_is_said(arguments: tuple[str, ...]) -> None:
    with open("/dev/full", "w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "lidario", *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
        )
    assert ended.returncode == 4
    assert "stdout cannot be written: No space left on device. Free some room" in ended.stderr


def test_a_forgotten_async_with() -> None:
    opened = lidario.open_lidar(S2)
    with pytest.raises(AttributeError, match=r"not open yet, so it has no 'scans': write `async with"):
        opened.scans()  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="'OpenLidar' object has no attribute 'scanz'"):
        opened.scanz()  # type: ignore[attr-defined]


@pytest.mark.parametrize("angle", [90, -20.0, 6.3, 360])
def test_degrees_for_radians_are_refused(angle: float) -> None:
    scan = make_scan([0.0], [1.0])
    for ask in (
        lambda: scan.at(angle),
        lambda: scan.nearest(between=(angle, 0.0)),
        lambda: scan.nearest(between=(0.0, angle)),
        lambda: scan.select(between=(0.0, angle)),
    ):
        with pytest.raises(lidario.InvalidValue, match=r"use math\.radians"):
            ask()
