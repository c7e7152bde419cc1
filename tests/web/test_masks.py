"""What a viewer draws: at once in what is shown, and saved for every program."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from lidario import Mount, read_config, save_config
from lidario.basics.model import DeviceInfo
from lidario.filters import AngularBoundsFilter, BoxFilter, ShadowsFilter
from lidario.testing import make_scan
from lidario.web.feed import Feed
from lidario.web.masks import Masks


def feeds(*places: Mount) -> list[Feed]:
    made = [Feed(f"lidar {number}", mount=place) for number, place in enumerate(places)]
    for number, feed in enumerate(made):
        feed.info = DeviceInfo("f", "m", 1, "1.0", 1, f"S{number}")
    return made


def test_boxes_are_for_all_and_sectors_for_one(tmp_path: Path) -> None:
    shown, path = feeds(Mount(), Mount(1.0)), tmp_path / "a.toml"
    masks = Masks(shown, path)
    assert masks.receive("b0.5 -0.5 -1.000 1.25")
    assert masks.receive("s1 10.00 30.00")
    box, sector = (-0.5, 0.5, -1.0, 1.25), AngularBoundsFilter([(math.radians(10), math.radians(30))], invert=True)
    assert shown[0].drawn == [BoxFilter(*box)]
    assert shown[1].drawn == [BoxFilter(*box, mount=Mount(1.0)), sector]
    assert masks.state() == {"may": True, "unsaved": 2, "said": ""}
    assert masks.receive("undo")
    assert len(shown[1].drawn) == 1
    assert masks.receive("save")
    assert masks.state() == {"may": True, "unsaved": 0, "said": f"saved in {path}"}
    assert read_config(path).of("s1").filters == (BoxFilter(*box, mount=Mount(1.0)),)
    assert masks.receive("undo")  # harmless


def test_what_stands_in_the_file_is_taken_away(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    body, shadows = BoxFilter(-0.5, 0.5, -0.25, 0.25), ShadowsFilter()
    posts = AngularBoundsFilter([(1.0, 1.2), (-2.0, -1.5)], invert=True)
    save_config(path, "", filters=[body, shadows])
    save_config(path, "S0", mount=Mount(0.2), filters=[posts])
    shown = feeds(Mount(0.2), Mount())
    for number, feed in enumerate(shown):
        feed.saved = read_config(path).of(f"S{number}").filters
    masks = Masks(shown, path)
    assert masks.receive("x-0.500 0.500 -0.250 0.250")
    assert masks.receive(f"x0 {math.degrees(1.0):.2f} {math.degrees(1.2):.2f}")
    left = AngularBoundsFilter([(-2.0, -1.5)], invert=True)
    assert [feed.filters for feed in shown] == [(shadows, left), (shadows,)]
    masks.receive("undo")
    assert shown[0].filters == (shadows, posts)
    masks.receive("undo")
    assert shown[1].filters == (body, shadows)
    assert masks.state()["unsaved"] == 0
    for message in ("x-0.500 0.500 -0.250 0.250", "b1 2 1 2", "x1.000 2.000 1.000 2.000", "x0 -114.59 -85.94"):
        assert masks.receive(message)
    masks.receive("save")
    assert masks.said == f"saved in {path}"
    saved = read_config(path)
    assert saved.default.filters == (shadows,)
    assert saved.of("s0").filters == (shadows, AngularBoundsFilter([(1.0, 1.2)], invert=True))
    assert saved.of("s1").filters == (shadows,)
    assert [feed.filters for feed in shown] == [saved.of("s0").filters, saved.of("s1").filters]
    assert masks.receive("x5 5 5 5")  # nobody has it
    assert masks.state()["unsaved"] == 0


def test_a_box_of_the_file_may_be_as_large_as_a_box_can_be(tmp_path: Path) -> None:
    (shown,) = feeds(Mount())
    shown.saved = (BoxFilter(-1_000_000, 1000, -2, 2),)
    assert Masks([shown], tmp_path / "a.toml").receive("x-1000000.000 1000.000 -2.000 2.000")
    assert shown.filters == ()


@pytest.mark.parametrize(
    ("told", "window"),
    [("-370.00 -350.00", (-10, 10)), ("355.00 365.00", (-5, 5)), ("170.00 500.00", (170, 140)), ("-180 180", None)],
)
def test_sectors_of_a_lidar_that_is_turned(tmp_path: Path, told: str, window: tuple[float, float] | None) -> None:
    """The page counts on beyond a turn there."""
    shown = feeds(Mount(yaw=3.0))
    assert Masks(shown, tmp_path / "a.toml").receive(f"s0 {told}")
    scan = make_scan(np.radians(np.arange(-179.5, 180.0)), 2.0).filtered(*shown[0].filters)
    degrees = np.degrees(scan.angles)
    inside = np.ones(360, bool) if window is None else (degrees - window[0]) % 360 < (window[1] - window[0]) % 360
    np.testing.assert_array_equal(scan.left_out, inside)


@pytest.mark.parametrize(
    "message",
    [
        "x1 2 3",
        "x9 1 2",
        "x0 nan 1",
        "b1 2 3",
        "b1 2 3 4 5",
        "s9 1 2",
        "s0 30 10",
        "s0 0 400",
        "b1e9 2 3 4",
        "b1 1000001 3 4",
        "bnan 1 1 1",
        "saved",
        "",
    ],
)
def test_strange_messages_are_refused(tmp_path: Path, message: str) -> None:
    assert not Masks(feeds(Mount()), tmp_path / "a.toml").receive(message)
    assert not Masks(feeds(Mount()), None).receive("b1 2 3 4")


def test_a_lidar_that_tells_no_serial_number(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    for count, said in ((1, f"saved in {path}"), (2, "lidar 0 tells no serial number")):
        shown = feeds(*[Mount()] * count)
        shown[0].info = DeviceInfo("f", "m", 1, "1.0", 1, "")
        masks = Masks(shown, path)
        masks.receive("b0 1 0 1")
        masks.receive("save")
        assert masks.said.startswith(said)
    assert len(read_config(path).default.filters) == 1


@pytest.mark.parametrize(
    ("serials", "said"),
    [(("S0", ""), "lidar 1 tells no serial number"), (("S0", "s0"), "several lidars tell the serial number s0")],
)
def test_nothing_is_saved_where_lidars_are_alike(tmp_path: Path, serials: tuple[str, ...], said: str) -> None:
    path, shown = tmp_path / "a.toml", feeds(Mount(1.0), Mount(-1.0))
    for feed, serial in zip(shown, serials, strict=True):
        feed.info = DeviceInfo("f", "m", 1, "1.0", 1, serial)
    masks = Masks(shown, path)
    masks.receive("b0 1 0 1")
    masks.receive("save")
    assert masks.said.startswith(said)
    assert not path.exists()
    assert masks.state()["unsaved"] == 1
    # What concerns one lidar that can be told apart is saved.
    masks.receive("undo")
    masks.receive("s0 10 20")
    masks.receive("save")
    assert masks.said == f"saved in {path}"
    assert len(read_config(path).of("S0").filters) == 1


def test_no_more_than_fifty_and_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    shown = feeds(Mount())
    masks = Masks(shown, tmp_path / "none" / "a.toml")
    for _ in range(60):
        assert masks.receive("b0 1 0 1")
    assert len(shown[0].drawn) == 50
    masks.receive("save")
    assert "cannot be written" in masks.said
    assert masks.state()["unsaved"] == 50


def test_where_the_file_cannot_take_what_is_drawn_for_one_the_other_is_saved_once(tmp_path: Path) -> None:
    path, shown = tmp_path / "a.toml", feeds(Mount(), Mount(1.0))
    path.write_text('[lidars]\nS1 = { frame = "b" }\n[lidars.S0]\n')
    masks = Masks(shown, path)
    masks.receive("b0 1 0 1")
    masks.receive("s0 10 20")
    for _ in range(2):
        masks.receive("save")
        assert "cannot be written into it" in masks.said
        assert len(read_config(path).of("S0").filters) == 2
        assert (shown[0].filters, len(shown[1].filters)) == (read_config(path).of("S0").filters, 1)
        assert masks.state()["unsaved"] == 1
    masks.receive("undo")
    assert (len(shown[0].filters), len(shown[1].filters), masks.state()["unsaved"]) == (2, 0, 0)
