"""``lidario plot``: what the file shows."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from lidario.cli.chart import step_of, svg
from lidario.testing import make_scan
from tests.cli.processes import invoke, invoke_driven
from tests.cli.test_picture import FULL_TURN
from tests.reference.golden import load

SVG = "{http://www.w3.org/2000/svg}"
S2 = "sim://rplidar-s2?via=memory"


def dots(text: str) -> list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """Places of the points of each scan, shape (n, 2): to the right and down."""
    root = ElementTree.fromstring(text)
    paths = [each.get("d", "") for each in root.iter(f"{SVG}path") if each.get("stroke-linecap") == "round"]
    return [np.array(re.findall(r"M([\d.]+) ([\d.]+)h0", path), float).reshape(-1, 2) for path in paths]


def test_a_circle_is_round_and_to_scale() -> None:
    (places,) = dots(svg([make_scan(FULL_TURN, np.full(3600, 2.0))], "x"))
    assert len(places) == 3600
    radii = np.hypot(*(places - 400).T)
    # 340 dots are the reach.
    assert radii == pytest.approx(2.0 * 340 / 2.5, abs=0.1)


@pytest.mark.parametrize(
    ("angle", "right", "down"), [(0.0, 0, -1), (np.pi / 2, -1, 0), (-np.pi / 2, 1, 0), (np.pi, 0, 1)]
)
@pytest.mark.parametrize("polar", [False, True])
def test_forward_is_up_and_left_is_left(angle: float, right: int, down: int, polar: bool) -> None:
    ((place,),) = dots(svg([make_scan(np.array([angle]), np.array([3.0]))], "x", polar=polar))
    assert np.sign(np.round(place - 400)).tolist() == [right, down]


def test_the_grid_is_labelled_in_metres_to_scale() -> None:
    scan = make_scan(FULL_TURN, np.full(3600, 2.0))
    root = ElementTree.fromstring(svg([scan], "x"))
    places = {each.text: float(each.get("x", "0")) for each in root.iter(f"{SVG}text") if each.get("y") == "758.0"}
    assert places["2"] == pytest.approx(400 - 2.0 * 340 / 2.5, abs=0.1)
    assert places["0"] == 400


@pytest.mark.parametrize("reach", [0.05, 0.3, 1, 4.2, 7, 18, 40, 200])
def test_a_grid_has_a_number_of_lines_that_can_be_read(reach: float) -> None:
    assert reach / step_of(reach) <= 5


@pytest.mark.parametrize("polar", [False, True])
def test_every_dot_is_inside_and_what_is_not_drawn_is_said(polar: bool) -> None:
    ranges = np.full(3600, 2.0)
    ranges[:7] = 30.0
    text = svg([make_scan(FULL_TURN, ranges)], "x", polar=polar)
    (places,) = dots(text)
    assert len(places) == 3593
    away = np.hypot(*(places - 400).T) if polar else np.abs(places - 400).max(axis=1)
    assert away.max() <= 340.1
    assert "not drawn: 7 returns farther than 2.5 m" in text


def test_the_corners_of_a_square_room_lie_inside_the_outer_ring() -> None:
    """By x and y alone the outer ring would be at 2.5 m, and the corners lie at 3.25."""
    wall = 2.3 / np.maximum(np.abs(np.cos(FULL_TURN)), np.abs(np.sin(FULL_TURN)))
    (places,) = dots(svg([make_scan(FULL_TURN, wall)], "x", polar=True))
    assert len(places) > 0.99 * 3600
    assert np.hypot(*(places - 400).T).max() <= 340.1


def test_words_stand_above_the_dots_on_a_ground_of_their_own() -> None:
    text = svg([make_scan(FULL_TURN, np.full(3600, 2.0))], "x", polar=True)
    root = ElementTree.fromstring(text)
    (words,) = [each for each in root.iter(f"{SVG}g") if each.get("paint-order") == "stroke"]
    assert "2 m" in [each.text for each in words]
    drawn = list(root)
    last = max(at for at, each in enumerate(drawn) if each.get("stroke-linecap") == "round")
    assert drawn.index(words) > last


def test_several_scans_are_a_trail_that_grows_stronger() -> None:
    scans = [make_scan(FULL_TURN, np.full(3600, 2.0)) for _ in range(4)]
    root = ElementTree.fromstring(svg(scans, "x"))
    strong = [float(each.get("opacity", "0")) for each in root.iter(f"{SVG}path") if each.get("stroke-linecap")]
    assert strong == sorted(strong)
    assert strong[-1] > 2 * strong[-2] - 0.01
    assert any((each.text or "").startswith("pale: 3 scans before") for each in root.iter(f"{SVG}text"))


def test_a_title_is_text_whatever_is_in_it() -> None:
    root = ElementTree.fromstring(svg([make_scan(FULL_TURN, np.full(3600, np.nan))], "<script>&"))
    texts = [each.text for each in root.iter(f"{SVG}text")]
    assert "<script>&" in texts
    assert "no returns in any direction" in texts


@pytest.mark.parametrize("options", [[], ["--polar", "-n", "3"]])
def test_the_command_writes_it(tmp_path: Path, options: list[str]) -> None:
    path = tmp_path / "a b.svg"
    ended = invoke_driven("plot", S2, "-o", str(path), *options, code=0)
    assert ended.stdout == f"{path}\n"
    drawn = dots(path.read_text(encoding="utf-8"))
    assert len(drawn) == (3 if options else 1)
    assert min(map(len, drawn)) > 3000


def test_a_name_that_is_only_its_ending_tells_the_kind_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke_driven("plot", S2, "-o", ".svg").exit_code == 0
    assert (tmp_path / ".svg").read_text().startswith("<svg")


def test_a_title_tells_nothing_that_is_not_known(tmp_path: Path) -> None:
    """The serial number of a device that has none; the day on which bare bytes came."""
    golden, raw = load("ydlidar_4ros_room10"), tmp_path / "raw.bin"
    raw.write_bytes(golden.raw)
    for source, title in (
        ("sim://ldrobot-ld19?via=memory", r"LDROBOT \S+ \S+ or alike, Standard, \d+ samples, 2\d{3}-.*"),
        (f"{raw}?family=ydlidar", r"YDLIDAR[^,]*, [^,]+, \d+ samples"),
    ):
        path = tmp_path / "x.svg"
        assert invoke_driven("plot", source, "-o", str(path), "--force").exit_code == 0
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
        texts = [each.text for each in root.iter(f"{SVG}text") if each.text]
        assert [each for each in texts if re.fullmatch(title, each)], texts


def test_an_empty_scan_is_said(tmp_path: Path) -> None:
    ended = invoke_driven("plot", S2 + "&world=empty", "-o", str(tmp_path / "x.svg"), code=0)
    assert "no returns" in ended.stderr


def test_a_missing_device_leaves_no_file(tmp_path: Path) -> None:
    invoke("plot", "/dev/nosuchport", "-o", str(tmp_path / "x.svg"), code=3)
    assert not list(tmp_path.iterdir())


class Drawn:
    """Stands for ``matplotlib.pyplot`` and all that it makes: notes what is called, and writes a file."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []

    def __getattr__(self, name: str) -> Callable[..., Drawn]:
        def call(*arguments: Any, **options: Any) -> Drawn:
            self.calls.append((name, arguments, options))
            if name == "savefig":
                arguments[0].write(b"\x89PNG")
            return self

        return call


@pytest.mark.parametrize("polar", [False, True])
def test_a_png_has_the_points_where_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, polar: bool) -> None:
    """All but matplotlib itself, which is not installed for the tests."""
    drawn = Drawn()
    monkeypatch.setattr("lidario.cli.errors.find_spec", lambda name: object())
    monkeypatch.setattr("lidario.cli.plot.import_module", lambda name: drawn)
    path = tmp_path / "x.png"
    ended = invoke_driven("plot", S2 + "&world=circle", "-o", str(path), "-n", "2", *(["--polar"] if polar else []))
    assert (ended.exit_code, ended.stdout) == (0, f"{path}\n"), ended.stderr
    assert path.read_bytes() == b"\x89PNG"
    points = [each[:2] for name, each, _ in drawn.calls if name == "plot" and np.size(each[0]) > 1]
    assert len(points) == 2
    for across, up in points:
        assert len(across) == len(up) > 3000
        if polar:
            # Angles counter-clockwise from forward, and distances.
            assert np.abs(across).max() <= np.float32(np.pi)
            assert up.min() > 0
    if polar:
        assert [each for name, each, _ in drawn.calls if name == "set_theta_zero_location"] == [("N",)]
    else:
        # Left is left: y grows to the left.
        ((left, right),) = [options["xlim"] for _, _, options in drawn.calls if "xlim" in options]
        assert left > 0 > right
