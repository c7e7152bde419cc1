"""What a first user does wrong, and the words that say how it is done."""

import pytest

import lidario
from lidario.session.finding import discovery
from lidario.testing import make_scan
from tests.cli.processes import invoke

S2 = "sim://rplidar-s2?via=memory"


def test_without_a_lidar_a_simulated_one_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "list_serial_ports", list)
    for verb in ("scan", "info", "stats", "record", "plot"):
        ended = invoke(verb, code=3)
        assert "Without a lidar, a simulated one does: sim://rplidar-s2" in ended.stderr


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
