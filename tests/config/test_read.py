"""The file of settings: what it says of which lidar, and a sentence for each mistake."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import pytest

from lidario import InvalidValue, LidarConfig, Mount, read_config
from lidario.filters import BoxFilter, RangeFilter, ShadowsFilter

WHOLE = """
[default]
mode = "Standard"
frame = "laser"
[[default.filters]]
filter = "ShadowsFilter"

[lidars.AbC]
mount = { x = 0.2, yaw_deg = 90 }
frame = "front"
mode = 2
speed_rpm = 600
[[lidars.AbC.filters]]
filter = "BoxFilter"
min_x = -0.3
max_x = 0.3
min_y = -0.2
max_y = 0.2
[[lidars.AbC.filters]]
filter = "RangeFilter"
lower_threshold = 0.1

[lidars.other]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "lidario.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_a_lidar_says_takes_the_place_of_the_default_and_filters_are_added(tmp_path: Path) -> None:
    config = read_config(written(tmp_path, WHOLE))
    mount = Mount(0.2, 0.0, math.pi / 2)
    filters = (ShadowsFilter(), BoxFilter(-0.3, 0.3, -0.2, 0.2, mount=mount), RangeFilter(0.1))
    assert config.of("aBc") == LidarConfig(mount, "front", 2, 600.0, filters)
    assert config.of("other") == config.of("nobody") == LidarConfig(None, "laser", "Standard", None, filters[:1])
    assert pickle.loads(pickle.dumps(config)) == config


def test_an_empty_file_says_nothing(tmp_path: Path) -> None:
    assert read_config(written(tmp_path, "")).of("x") == LidarConfig()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[defualt]", "'defualt' means nothing here; there are default, lidars"),
        ("x = [", "is no TOML"),
        pytest.param("x = " + "1" * 5000, "is no TOML", id="a number of 5000 digits"),
        ("[default]\nmod = 1", r"\[default\]: 'mod' means nothing here; there are mount, frame, mode"),
        ("[lidars.A]\nspeed_rpm = 0", r"\[lidars.A\]: speed_rpm is revolutions a minute, above 0, not 0"),
        ("[lidars.A]\nspeed_rpm = true", r"speed_rpm is a number, not True"),
        ("[lidars.A]\nspeed_rpm = nan", r"speed_rpm"),
        ("[lidars.A]\nmode = 1.5", r"mode is the name of a scan mode or its number, not 1.5"),
        ("[lidars.A]\nframe = ''", r"frame is the name of a frame"),
        ("[lidars.A]\nmount = 3", r"\[lidars.A\]: mount is a table, not 3"),
        ("[lidars.A]\nmount = {yaw = 3}", r"'yaw' means nothing here; there are x, y, yaw_deg"),
        ("[lidars.A]\nmount = {x = 'a'}", r"mount: x"),
        ("[lidars.A]\nmount = {x = 1e300}", r"\[lidars.A\]: mount: x of a Mount is a number, at most 1e\+06 away"),
        ("[lidars]\nA = 3", r"\[lidars.A\] is a table, not 3"),
        ("[lidars.A]\n[lidars.a]", "twice"),
        ("[lidars.A]\nfilters = 3", r"filters are a list"),
        ("[[lidars.A.filters]]", r"filter 1: filter is one of AngularBoundsFilter, BoxFilter"),
        ("[[lidars.A.filters]]\nfilter = 'MaskFilter'", r"filter is one of"),
        ("[[lidars.A.filters]]\nfilter = ['x']", r"filter is one of"),
        ("[[lidars.A.filters]]\nfilter = 'BoxFilter'\nmin_x = 1", "BoxFilter needs max_x and min_y and max_y"),
        ("[[lidars.A.filters]]\nfilter = 'RangeFilter'\nmin = 1", "'min' means nothing here; there are lower_thr"),
        (
            "[[lidars.A.filters]]\nfilter = 'BoxFilter'\nmin_x = 1\nmax_x = 0\nmin_y = 0\nmax_y = 1",
            r"filter 1: BoxFilter: min_x 1 is above max_x 0",
        ),
        (
            "[[lidars.A.filters]]\nfilter = 'AngularBoundsFilter'\nwindows = [[1, 2]]\ninvert = 'no'",
            r"filter 1: AngularBoundsFilter: invert is True or False, not 'no'",
        ),
        (
            "[[lidars.A.filters]]\nfilter = 'PolygonFilter'\npolygon = [[0, 0]]\nmount = 1",
            "'mount' means nothing here",
        ),
    ],
)
def test_a_mistake_is_told_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InvalidValue, match=words) as caught:
        read_config(path)
    assert str(path) in str(caught.value)


def test_what_is_no_text_or_not_there(tmp_path: Path) -> None:
    with pytest.raises(InvalidValue, match="cannot be read: no such file"):
        read_config(tmp_path / "none.toml")
    path = tmp_path / "bytes.toml"
    path.write_bytes(b"x = '\xff'")
    with pytest.raises(InvalidValue, match="no text in UTF-8, from byte 5"):
        read_config(path)
    path.write_bytes(b"a = " + b"[" * 100_000)
    with pytest.raises(InvalidValue, match=r"bytes\.toml"):
        read_config(path)
    path.write_bytes(b"#" * (1 << 21))
    with pytest.raises(InvalidValue, match="more than 1048576 bytes"):
        read_config(path)
