"""What a first user does wrong, and the words that say how it is done."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import lidario
from lidario.session.finding import discovery
from lidario.testing import make_scan
from tests.cli.processes import invoke, invoke_driven

S2 = "sim://rplidar-s2?via=memory"


def test_without_a_lidar_a_simulated_one_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "list_serial_ports", list)
    for verb in ("scan", "info", "stats", "record", "plot"):
        ended = invoke(verb)
        assert ended.exit_code == 3
        assert "Without a lidar, a simulated one does: sim://rplidar-s2" in ended.stderr


def test_a_picture_that_is_there_is_replaced_by_force(tmp_path: Path) -> None:
    path = tmp_path / "scan.svg"
    path.write_text("mine")
    ended = invoke_driven("plot", S2, "-o", str(path))
    assert ended.exit_code == 4
    assert "--force, replaces it" in ended.stderr
    assert path.read_text() == "mine"
    assert invoke_driven("plot", S2, "-o", str(path), "--force").exit_code == 0
    assert path.read_text().startswith("<svg")
    assert os.listdir(tmp_path) == ["scan.svg"]


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
