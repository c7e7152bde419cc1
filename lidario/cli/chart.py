"""Scans as an SVG picture for a report: points to scale, on a grid in metres or on rings and rays.

Forward (x) is up and left (y) is left, as seen from above. Nothing is needed to write it. One point is one round
dot: a line of no length with round ends, which all viewers of SVG draw, and which takes ten bytes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final
from xml.sax.saxutils import escape

import numpy as np

from lidario import Scan

__all__ = ["COLOURS", "reach_of", "step_of", "svg"]

COLOURS: Final = ("#1b5fc1", "#d1495b", "#2e933c", "#b8860b", "#7a4fb5", "#00838f")
"""One scan after the other; readable on white, also when they are printed."""
SIZE: Final = 800
EDGE: Final = 60
SHOWN: Final = 0.995
"""Share of the returns that must be on the picture; one beam through a door shall not shrink the room."""
_STEPS_M: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
_LINES: Final = 5


def reach_of(scans: Sequence[Scan]) -> float:
    """Metres from the lidar to the edge of the picture, a whole number of steps."""
    points = np.concatenate([scan.xy()[scan.valid] for scan in scans]) if scans else np.empty((0, 2))
    reach = float(np.quantile(np.abs(points).max(axis=1), SHOWN)) * 1.04 if len(points) else 1.0
    reach = max(reach, _STEPS_M[0])
    return math.ceil(reach / step_of(reach)) * step_of(reach)


def step_of(reach: float) -> float:
    """Metres from one line of the grid to the next."""
    return next((step for step in _STEPS_M if reach / step <= _LINES), _STEPS_M[-1])


def svg(scans: Sequence[Scan], title: str, *, polar: bool = False) -> str:
    """The picture of these scans, one over the other, as the text of a file."""
    reach = reach_of(scans)
    half = (SIZE - 2 * EDGE) / 2
    middle, scale = SIZE / 2, half / reach
    grid = _rings(middle, scale, reach) if polar else _squares(middle, scale, reach)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE} {SIZE}" font-family="sans-serif" '
        f'font-size="14" fill="#333">',
        f'<rect width="{SIZE}" height="{SIZE}" fill="#fff"/>',
        f'<text x="{middle}" y="24" text-anchor="middle" font-size="16">{escape(title)}</text>',
        f'<g stroke="#ddd" fill="none">{grid[0]}</g>',
        f"<g>{grid[1]}</g>",
    ]
    for number, scan in enumerate(scans):
        points = scan.xy()[scan.valid].astype(np.float64) * scale
        inside = (np.abs(points) <= half).all(axis=1)
        across, down = middle - points[inside, 1], middle - points[inside, 0]
        dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in zip(across.tolist(), down.tolist(), strict=True))
        colour = COLOURS[number % len(COLOURS)]
        parts.append(f'<path d="{dots}" stroke="{colour}" stroke-width="2.2" stroke-linecap="round" opacity=".8"/>')
        if not inside.size:
            parts.append(
                f'<text x="{middle}" y="{middle + 60}" text-anchor="middle">no returns in any direction</text>'
            )
    if not any(scan.valid.any() for scan in scans):
        parts.append(
            f'<text x="{middle}" y="{middle + 60}" text-anchor="middle">no returns in any direction</text>'
        )
    parts.append(f'<path d="M{middle} {middle - 9}l6 15l-6-4l-6 4z" fill="#000"/></svg>')
    return "\n".join(parts) + "\n"


def _values(reach: float) -> list[float]:
    step = step_of(reach)
    count = round(reach / step)
    return [number * step for number in range(-count, count + 1)]


def _squares(middle: float, scale: float, reach: float) -> tuple[str, str]:
    """Lines and their labels."""
    low, high = middle - reach * scale, middle + reach * scale
    lines, labels = "", ""
    for value in _values(reach):
        at = middle - value * scale
        lines += f'<path d="M{at:.1f} {low:.1f}V{high:.1f}M{low:.1f} {at:.1f}H{high:.1f}"/>'
        labels += f'<text x="{at:.1f}" y="{high + 18:.1f}" text-anchor="middle">{value:g}</text>'
        labels += f'<text x="{low - 6:.1f}" y="{at + 5:.1f}" text-anchor="end">{value:g}</text>'
    labels += f'<text x="{middle}" y="{high + 40:.1f}" text-anchor="middle">y, to the left (m)</text>'
    labels += f'<text transform="translate(18 {middle})rotate(-90)" text-anchor="middle">x, forward (m)</text>'
    return lines, labels


def _rings(middle: float, scale: float, reach: float) -> tuple[str, str]:
    lines, labels = "", ""
    for value in _values(reach):
        if value > 0:
            radius = value * scale
            lines += f'<circle cx="{middle}" cy="{middle}" r="{radius:.1f}"/>'
            labels += f'<text x="{middle + 4}" y="{middle - radius + 15:.1f}" fill="#777">{value:g} m</text>'
    for degrees in range(0, 360, 30):
        sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
        far = reach * scale
        lines += f'<path d="M{middle} {middle}L{middle - far * sine:.1f} {middle - far * cosine:.1f}"/>'
        x, y = middle - (far + 18) * sine, middle - (far + 18) * cosine + 5
        labels += f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{degrees}°</text>'
    return lines, labels
