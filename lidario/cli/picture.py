"""A small picture of a scan for the terminal, seen from above, forward up.

A braille character has two by four dots and a terminal's cell is about twice as high as wide, so the dots make
a square grid and the room keeps its shape. The lidar is in the middle; the scale is the largest at which nearly
every return is on the picture, so that one beam through an open door does not shrink the room. Colours
show the distance where the terminal has colours; where it cannot show braille, every cell with a return is a #.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.style import Style
from rich.text import Text

import lidario
from lidario.basics.words import counted

MOST_COLUMNS: Final = 99
ROWS_OFF_TERMINAL: Final = 31
LEAST_ROWS: Final = 15
MOST_ROWS: Final = 45
ROWS_BESIDE: Final = 7
"""Lines of a terminal that are left for the rest of the output and the prompt."""
ON_PICTURE: Final = 0.99
SMALLEST_M: Final = 0.5
STEPS_A_DECADE: Final = 10
"""Scales of a drawing that is drawn again and again; each is a quarter larger than the one before."""

_DOTS: Final = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], np.uint8)
_BRAILLE: Final = 0x2800
_COLOURS: Final = ("#e5484d", "#ee7d21", "#c9a100", "#3f9f46", "#1795a8", "#3d7be0", "#8a63d2")
"""From near to far; each is readable on a dark and on a light ground."""
_LENGTHS_M: Final = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50)
_BAR_CELLS: Final = 14


@dataclass(frozen=True, slots=True)
class _Grid:
    """The scan on cells."""

    dots: NDArray[np.uint8]  # braille pattern of each cell, shape (rows, columns)
    nearest: NDArray[np.float64]  # range of the nearest return in each cell; infinite where there is none
    cell_m: float  # width of a cell in metres; it is twice as high
    farthest_m: float  # range of the farthest return on the picture
    outside: int  # returns that lie beyond its edges


def picture(scan: lidario.Scan, target: Console, *, size: tuple[int, int] | None = None) -> Text:
    """Draw `scan` to fit `target`, whose colours and characters are used.

    With `size` in columns and rows it has all its rows, and a scale that changes in steps: drawn again and again,
    it does not move with each scan.
    """
    if not scan.valid.any():
        return Text("no returns in any direction: there is nothing to draw")
    columns, rows = min(target.width - 1, MOST_COLUMNS), ROWS_OFF_TERMINAL
    if target.is_terminal:
        rows = min(max(target.height - ROWS_BESIDE, LEAST_ROWS), MOST_ROWS)
    if size is not None:
        columns, rows = size
    # Odd numbers, so that there is a cell in the middle.
    columns, rows = max(columns - 1 + columns % 2, 3), max(rows - 1 + rows % 2, 3)
    grid = _rasterise(scan, columns, rows, steady=size is not None)
    plain = target.options.ascii_only
    coloured = target.color_system is not None and not target.no_color
    text = Text(no_wrap=True, overflow="crop")
    for row in _drawn_rows(grid) if size is None else range(rows):
        text.append_text(_line(grid, row, plain=plain, coloured=coloured))
        text.append("\n")
    text.append_text(_legend(grid, plain=plain, coloured=coloured))
    return text


def _rasterise(scan: lidario.Scan, columns: int, rows: int, *, steady: bool) -> _Grid:
    points = scan.xy()[scan.valid].astype(np.float64)
    ranges = scan.ranges[scan.valid].astype(np.float64)
    # Metres a dot that each point would need to be on the picture; x is up, y to the left.
    needed = np.maximum(np.abs(points[:, 0]) / (2 * rows), np.abs(points[:, 1]) / columns)
    dot_m = float(np.quantile(needed, ON_PICTURE)) * 1.02
    dot_m = max(dot_m, SMALLEST_M / (2 * rows))
    if steady:
        dot_m = 10 ** (math.ceil(math.log10(dot_m) * STEPS_A_DECADE) / STEPS_A_DECADE)
    across = np.floor(columns - points[:, 1] / dot_m).astype(np.intp)
    down = np.floor(2 * rows - points[:, 0] / dot_m).astype(np.intp)
    inside = (across >= 0) & (across < 2 * columns) & (down >= 0) & (down < 4 * rows)
    across, down, ranges = across[inside], down[inside], ranges[inside]

    dots = np.zeros((rows, columns), np.uint8)
    np.bitwise_or.at(dots, (down // 4, across // 2), _DOTS[down % 4, across % 2])
    nearest = np.full((rows, columns), np.inf)
    np.minimum.at(nearest, (down // 4, across // 2), ranges)
    return _Grid(dots, nearest, 2 * dot_m, float(ranges.max()), int(np.count_nonzero(~inside)))


def _drawn_rows(grid: _Grid) -> range:
    """The rows from the first to the last return, the lidar's own included."""
    used = np.flatnonzero(grid.dots.any(axis=1))
    middle = grid.dots.shape[0] // 2
    return range(min(int(used[0]), middle), max(int(used[-1]), middle) + 1)


def _line(grid: _Grid, row: int, *, plain: bool, coloured: bool) -> Text:
    rows, columns = grid.dots.shape
    line = Text()
    used = np.flatnonzero(grid.dots[row])
    end = int(used[-1]) + 1 if used.size else 0
    if row == rows // 2:
        end = max(end, columns // 2 + 1)
    for column in range(end):
        if row == rows // 2 and column == columns // 2:
            line.append("^" if plain else "▲", Style(bold=True))
        elif not grid.dots[row, column]:
            line.append(" ")
        else:
            mark = "#" if plain else chr(_BRAILLE + int(grid.dots[row, column]))
            step = int(grid.nearest[row, column] / grid.farthest_m * len(_COLOURS))
            line.append(mark, Style(color=_COLOURS[min(step, len(_COLOURS) - 1)]) if coloured else None)
    return line


def _legend(grid: _Grid, *, plain: bool, coloured: bool) -> Text:
    """What a length on the picture is in metres, where forward is, and what the colours mean."""
    length = max((each for each in _LENGTHS_M if each <= _BAR_CELLS * grid.cell_m), default=_LENGTHS_M[0])
    cells = max(round(length / grid.cell_m), 2)
    left, middle, right, device, full = "|-|^#" if plain else "├─┤▲█"
    legend = Text(f"{left}{middle * (cells - 2)}{right} {length:g} m   {device} lidar, forward is up")
    if coloured:
        legend.append("   0 ")
        for colour in _COLOURS:
            legend.append(2 * full, Style(color=colour))
        legend.append(f" {grid.farthest_m:.1f} m")
    if grid.outside:
        legend.append(f"   {counted(grid.outside, 'return')} outside")
    return legend
