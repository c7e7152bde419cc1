"""Writing into the file of settings: what is there stays, what is added is read again."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import pytest

from lidario import InvalidValue, LidarConfig, Mount, read_config, save_config
from lidario.filters import AngularBoundsFilter, BoxFilter, MedianFilter, PolygonFilter, RangeFilter, ShadowsFilter
from tests.config.test_read import WHOLE, written


def test_a_file_that_is_not_there_is_made(tmp_path: Path) -> None:
    path = tmp_path / "lidario.toml"
    mount = Mount(0.1234, -0.5, math.radians(-90))
    added = [
        AngularBoundsFilter([(1.0, 2.0)], invert=True),
        PolygonFilter([(0, 0), (1, 0), (1, 1)], mount=mount),
        MedianFilter(),
    ]
    save_config(path, "AB12", mount=mount, filters=added)
    own = read_config(path).of("ab12")
    assert own.mount is not None
    assert (own.mount.x, own.mount.y, own.mount.yaw) == pytest.approx((mount.x, mount.y, mount.yaw))
    assert own.filters == (added[0], PolygonFilter([(0, 0), (1, 0), (1, 1)], mount=own.mount), added[2])
    assert path.read_text().startswith("# ")


def test_what_was_there_stays_as_it_was_written(tmp_path: Path) -> None:
    path = written(tmp_path, "# ours\n" + WHOLE)
    before = read_config(path)
    save_config(path, "abc", filters=[BoxFilter(0, 1, 0, 1)])
    save_config(path, "new one", mount=Mount(1.0))
    save_config(path, "", filters=[MedianFilter()])
    config, text = read_config(path), path.read_text()
    assert text.startswith("# ours\n")
    assert "speed_rpm = 600" in text
    assert "lidars.abc" not in text
    own, mount = config.of("abc"), before.of("abc").mount
    assert mount is not None
    assert own.filters[:1] == before.default.filters
    assert own.filters[1] == MedianFilter()
    assert own.filters[2:] == (*before.of("abc").filters[1:], BoxFilter(0, 1, 0, 1, mount=mount))
    assert config.of("new one").mount == Mount(1.0)
    assert list(tmp_path.iterdir()) == [path]


def test_a_wrong_file_is_left_alone(tmp_path: Path) -> None:
    path = written(tmp_path, "[defualt]")
    with pytest.raises(InvalidValue, match="defualt"):
        save_config(path, "a", mount=Mount())
    assert path.read_text() == "[defualt]"
    with pytest.raises(InvalidValue, match="cannot be written"):
        save_config(tmp_path / "none" / "x.toml", "a", mount=Mount())
    with pytest.raises(InvalidValue, match=r"filters of lidario\.filters"):
        save_config(tmp_path / "x.toml", "a", filters=[len])  # type: ignore[list-item]


def test_a_file_as_windows_writes_it_is_read_and_written(tmp_path: Path) -> None:
    """With a byte order mark in front, and two bytes where a line ends."""
    path = tmp_path / "lidario.toml"
    path.write_bytes(b'\xef\xbb\xbf[default]\r\nframe = "front"  # mine\r\n')
    assert read_config(path).default.frame == "front"
    save_config(path, "1234", mount=Mount(x=0.5))
    config = read_config(path)
    assert (config.default.frame, config.of("1234").mount) == ("front", Mount(x=0.5))
    assert b'frame = "front"  # mine\r\n' in path.read_bytes()


@pytest.mark.parametrize("has_nameless", [True, False])
def test_it_is_replaced_in_one_step_and_is_as_readable_as_before(
    tmp_path: Path, has_nameless: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not has_nameless:
        monkeypatch.delattr(os, "O_TMPFILE", raising=False)
    path, replace = written(tmp_path, "[default]\n"), os.replace
    path.chmod(0o640)
    save_config(path, "a", mount=Mount(2.0))
    assert path.stat().st_mode & 0o777 == 0o640
    before = path.read_bytes()

    def fail(new: str, old: Path) -> None:
        assert b"3.0" in Path(new).read_bytes()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(InvalidValue, match="cannot be written: no space left"):
        save_config(path, "a", mount=Mount(3.0))
    monkeypatch.setattr(os, "replace", replace)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("inline", [False, True])
def test_filters_are_taken_away_and_all_else_stays(tmp_path: Path, inline: bool) -> None:
    body = "filter = 'BoxFilter', min_x = -0.3, max_x = 0.3, min_y = -0.2, max_y = 0.2"
    posts = "filter = 'AngularBoundsFilter', windows = [[1, 2]], invert = true"
    lines = (
        [f"filters = [{{{body}}}, {{filter = 'ShadowsFilter'}}]", "[lidars.a]", f"filters = [{{{posts}}}]"]
        if inline
        else [
            *("[[default.filters]]", *body.split(", "), "[[default.filters]] # mine", "filter = 'ShadowsFilter'"),
            *("[[lidars.a.filters]]", posts.replace(", w", "\nw").replace(", i", "\ni")),
        ]
    )
    path = written(tmp_path, "\n".join(["[default]", "speed_rpm = 500", *lines, "mount = {x = 1}" * inline]))
    gone = BoxFilter(-0.3, 0.3, -0.2, 0.2, mount=Mount(1.0)), AngularBoundsFilter([(1.0, 2.0)], invert=True)
    save_config(path, "A", filters=[MedianFilter()], without=[gone[0]])
    assert read_config(path).of("a").filters == (ShadowsFilter(), gone[1], MedianFilter())
    save_config(path, "a", without=gone)
    assert read_config(path).of("a").filters == (ShadowsFilter(), MedianFilter())
    assert read_config(path).default.speed_rpm == 500
    save_config(path, "a", without=[ShadowsFilter(), MedianFilter()])
    assert read_config(path).of("a").filters == ()
    assert "filters" not in path.read_text()


NEAR = '[[lidars.A.filters]]\nfilter = "RangeFilter"\nlower_threshold = 0.5'
MEDIAN = '[[lidars.A.filters]]\nfilter = "MedianFilter"'


@pytest.mark.parametrize(
    ("parts", "kept"),
    [
        (["[lidars.A]\nframe = 'f'", "# on A", NEAR, "\n# on B", "[lidars.B]"], [0, 1, 3, 4]),
        (["[lidars.A]", MEDIAN, "# on near", NEAR, "\n# on B", "[lidars.B]"], [0, 1, 2, 4, 5]),
        (["[lidars.A]", NEAR, "# on median", MEDIAN, "\n# on B", "[lidars.B]"], [0, 2, 3, 4, 5]),
        (["[lidars.A]", NEAR, "# on median", MEDIAN, "# on near", NEAR, "# the end"], [0, 2, 3, 4, 6]),
        (["[lidars.A]", "[lidars.B]", NEAR], [0, 1]),
        ([NEAR, "[lidars.B]", "[lidars.A]\nframe = 'f'", "# the end"], [1, 2, 3]),
    ],
)
def test_comments_around_a_filter_taken_away_stay(tmp_path: Path, parts: list[str], kept: list[int]) -> None:
    path = written(tmp_path, "\n".join(parts))
    save_config(path, "A", without=[RangeFilter(0.5)])
    lines = [line for line in path.read_text().splitlines() if line]
    assert lines == [line for each in kept for line in parts[each].splitlines() if line]


BOX = BoxFilter(-1, 1, -1, 1)


@pytest.mark.parametrize(
    ("text", "how"),
    [
        ('[lidars]\nA = { frame = "a" }\n', {"filters": [BOX]}),
        ('default = { frame = "d" }\n', {"filters": [BOX], "serial": ""}),
        ('lidars.A.frame = "a"\nlidars.B.frame = "b"\n', {"filters": [BOX]}),
        ('lidars.B.frame = "b"\nlidars.C.frame = "c"\n', {"mount": Mount(1.0)}),
        ('lidars = { B = { frame = "b" } }\n', {"mount": Mount(1.0)}),
        (
            '[[lidars.A.filters]]\nfilter = "RangeFilter"\n[lidars.B]\n'
            '[[lidars.A.filters]]\nfilter = "ShadowsFilter"\n',
            {"filters": [BOX]},
        ),
    ],
)
def test_a_file_that_cannot_take_it_is_left_as_it_was(tmp_path: Path, text: str, how: dict[str, Any]) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InvalidValue, match=r"lidario\.toml.*cannot be written into it"):
        save_config(path, **{"serial": "A", **how})
    assert path.read_text() == text
    assert list(tmp_path.iterdir()) == [path]


def test_what_can_stand_in_an_inline_table_is_written_there(tmp_path: Path) -> None:
    path = written(tmp_path, 'lidars = { A = { frame = "a" } }\n')
    save_config(path, "a", mount=Mount(1.0, 2.0))
    assert read_config(path).of("A") == LidarConfig(Mount(1.0, 2.0), "a")
