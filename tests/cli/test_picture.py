"""The picture of a scan: its shape, its orientation, its width, its colours."""

import io

import numpy as np
import pytest
from rich.console import Console

from lidario import Scan
from lidario.cli.output import rendered
from lidario.cli.picture import picture
from lidario.testing import make_scan

FULL_TURN = np.linspace(-np.pi, np.pi, 3600, endpoint=False)


def drawn(scan: Scan, *, width: int = 80, colours: str | None = None, encoding: str = "utf-8") -> list[str]:
    """The lines of the picture; the last one is the legend."""
    file = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    console = Console(
        file=file, width=width, height=60, force_terminal=True, color_system=colours,  # type: ignore[arg-type]
        no_color=False, legacy_windows=False, _environ={},
    )  # fmt: skip
    return rendered(console, picture(scan, console)).splitlines()


def ink(lines: list[str]) -> list[tuple[int, int]]:
    """Row and column of every cell with something in it, without the legend and the lidar."""
    return [
        (row, column)
        for row, line in enumerate(lines[:-1])
        for column, character in enumerate(line)
        if character not in " ▲^"
    ]


def device(lines: list[str]) -> tuple[int, int]:
    return next((row, line.index("▲")) for row, line in enumerate(lines[:-1]) if "▲" in line)


def test_a_circle_is_round_in_cells_twice_as_high_as_wide_and_the_lidar_is_in_its_middle() -> None:
    lines = drawn(make_scan(FULL_TURN, np.full(3600, 2.0)))
    rows, columns = zip(*ink(lines), strict=True)
    high, wide = max(rows) - min(rows) + 1, max(columns) - min(columns) + 1
    assert wide == pytest.approx(2 * high, abs=2)
    assert device(lines) == pytest.approx(((min(rows) + max(rows)) / 2, (min(columns) + max(columns)) / 2), abs=1)


@pytest.mark.parametrize(
    ("angle", "down", "right"), [(0.0, -1, 0), (np.pi / 2, 0, -1), (-np.pi / 2, 0, 1), (np.pi, 1, 0)]
)
def test_forward_is_up_and_left_is_left(angle: float, down: int, right: int) -> None:
    lines = drawn(make_scan(np.array([angle]), np.array([3.0])))
    ((row, column),) = ink(lines)
    own_row, own_column = device(lines)
    assert np.sign(row - own_row) == down
    assert np.sign(column - own_column) == right


def test_one_far_beam_does_not_shrink_the_room() -> None:
    ranges = np.full(3600, 2.0)
    ranges[900] = 30.0
    with_beam = drawn(make_scan(FULL_TURN, ranges))
    assert abs(len(with_beam) - len(drawn(make_scan(FULL_TURN, np.full(3600, 2.0))))) <= 1
    assert with_beam[-1].endswith("1 return outside")


def test_the_scale_is_true() -> None:
    lines = drawn(make_scan(FULL_TURN, np.full(3600, 2.0)))
    columns = [column for _, column in ink(lines)]
    bar, metres = lines[-1].split()[:2]
    assert len(bar) / (max(columns) - min(columns) + 1) == pytest.approx(float(metres) / 4.0, rel=0.1)


def test_samples_without_a_return_are_not_drawn() -> None:
    ranges = np.full(3600, np.nan)
    ranges[:10] = 2.0
    assert 1 <= len(ink(drawn(make_scan(FULL_TURN, ranges)))) <= 4
    assert "no returns" in drawn(make_scan(FULL_TURN, np.full(3600, np.nan)))[0]


def test_colours_tell_near_from_far() -> None:
    ranges = np.where(np.abs(FULL_TURN) < np.pi / 2, 1.0, 4.0)
    plain = drawn(make_scan(FULL_TURN, ranges))
    assert not any("\x1b" in line for line in plain)
    coloured = drawn(make_scan(FULL_TURN, ranges), colours="truecolor")
    codes = {part.partition("m")[0] for line in coloured[:-1] for part in line.split("\x1b[38;2;")[1:]}
    assert len(codes) >= 2


@pytest.mark.parametrize("colours", [None, "truecolor"])
def test_ascii_where_the_terminal_has_no_braille(colours: str | None) -> None:
    """The scale of colours, too: it was a row of question marks."""
    lines = drawn(make_scan(FULL_TURN, np.full(3600, 2.0)), encoding="latin-1", colours=colours)
    assert all(line.isascii() for line in lines)
    assert any("#" in line for line in lines)
    assert any("^" in line for line in lines)
