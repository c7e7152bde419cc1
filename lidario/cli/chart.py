"""Scans as an SVG picture for a report: points to scale, on a grid in metres or on rings and rays.

Forward (x) is up and left (y) is left, as seen from above. Nothing is needed to write it. One point is one round
dot: a line of no length with round ends, which all viewers of SVG draw, and which takes ten bytes. Words stand
above all dots on a ground of their own, and a legend says what lies where nothing is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

import lidario
from lidario.basics.words import counted

COLOUR: Final = "#1b5fc1"
"""Readable on white, also when it is printed."""
_FAINTEST: Final = 0.12
SIZE: Final = 800
EDGE: Final = 60
MIDDLE: Final = SIZE / 2
HALF: Final = MIDDLE - EDGE
"""From the lidar in the middle to the edge of the grid."""
SHOWN: Final = 0.995
"""Share of the returns that must be on the picture; one beam through a door shall not shrink the room."""
_STEPS_M: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
_LINES: Final = 5
_LIDAR: Final = f'<path d="M{MIDDLE} {MIDDLE - 9}l6 15l-6-4l-6 4z" fill="#000"/></svg>'


def reach_of(scans: Sequence[lidario.Scan], *, polar: bool = False) -> float:
    """Metres from the lidar to the edge of the picture, a whole number of steps."""
    away = np.concatenate([_away(scan, polar) for scan in scans]) if scans else np.empty(0)
    reach = float(np.quantile(away, SHOWN)) * 1.04 if len(away) else 1.0
    reach = max(reach, _STEPS_M[0])
    return math.ceil(reach / step_of(reach)) * step_of(reach)


def step_of(reach: float) -> float:
    """Metres from one line of the grid to the next."""
    return next((step for step in _STEPS_M if reach / step <= _LINES), _STEPS_M[-1])


def opacities(count: int) -> list[float]:
    """Of so many scans, the oldest first: the latest one is strong, those before it are a trail."""
    return [0.85 if number == count - 1 else _FAINTEST + 0.3 * number / count for number in range(count)]


def legend_of(scans: Sequence[lidario.Scan], reach: float, *, polar: bool = False) -> list[str]:
    """What must be said of these scans beside the picture, a line each."""
    lines = []
    if len(scans) > 1:
        seconds = (scans[-1].stamp_ns - scans[0].stamp_ns) * 1e-9
        lines.append(f"pale: {counted(len(scans) - 1, 'scan')} before, up to {seconds:.1f} s")
    beyond = sum(int(np.count_nonzero(_away(scan, polar) > reach)) for scan in scans)
    if beyond:
        lines.append(f"not drawn: {counted(beyond, 'return')} farther than {reach:g} m")
    return lines


def _away(scan: lidario.Scan, polar: bool) -> NDArray[np.float64]:
    """How far out each return is: by its distance on rings, by its larger coordinate on a square."""
    points = np.abs(scan.xy()[scan.valid].astype(np.float64))
    away: NDArray[np.float64] = np.hypot(*points.T) if polar else points.max(axis=1)
    return away


def svg(scans: Sequence[lidario.Scan], title: str, *, polar: bool = False) -> str:
    """The picture of these scans, one over the other, as the text of a file."""
    reach = reach_of(scans, polar=polar)
    grid, names = _rings(reach) if polar else _squares(reach)
    dots = []
    for scan, opacity in zip(scans, opacities(len(scans)), strict=True):
        points = scan.xy()[scan.valid].astype(np.float64)[_away(scan, polar) <= reach] * (HALF / reach)
        dots.append(_dots(points, COLOUR, opacity))
    if not any(scan.valid.any() for scan in scans):
        names += f'<text x="{MIDDLE}" y="{MIDDLE + 60}" text-anchor="middle">no returns in any direction</text>'
    return _drawn(title, grid, dots, names, legend_of(scans, reach, polar=polar))


def clouds_svg(clouds: Sequence[tuple[NDArray[np.floating], str]], title: str, legend: str) -> str:
    """Clouds of points one over the other, each with its colour, as the text of a file; metres, shape (n, 2)."""
    far = np.concatenate([np.abs(xy).max(axis=1) for xy, _ in clouds])
    reach = max(1.0, math.ceil(float(np.quantile(far, SHOWN)) * 1.05)) if len(far) else 1.0
    grid, names = _squares(reach)
    dots = []
    for xy, colour in clouds:
        near = xy.astype(np.float64)[np.abs(xy).max(axis=1) <= reach] * (HALF / reach)
        # Several scans of one wall are on the same dots; each is drawn once.
        dots.append(_dots(np.unique(np.round(near, 1), axis=0), colour, 0.8))
    return _drawn(title, grid, dots, names, [legend])


def _drawn(title: str, grid: str, dots: Sequence[str], names: str, legend: Sequence[str]) -> str:
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE} {SIZE}" font-family="sans-serif" '
        f'font-size="14" fill="#333">',
        f'<rect width="{SIZE}" height="{SIZE}" fill="#fff"/>',
        f'<text x="{MIDDLE}" y="24" text-anchor="middle" font-size="16">{escape(title)}</text>',
        f'<g stroke="#ddd" fill="none">{grid}</g>',
        *dots,
        f'<g stroke="#fff" stroke-width="5" stroke-linejoin="round" paint-order="stroke">{names}</g>',
    ]
    for line, text in enumerate(reversed(legend)):
        parts.append(f'<text x="{SIZE - 12}" y="{SIZE - 10 - 18 * line}" text-anchor="end">{text}</text>')
    return "\n".join([*parts, _LIDAR]) + "\n"


def _dots(points: NDArray[np.float64], colour: str, opacity: float) -> str:
    """Points in dots of the picture, as from its middle: forward, to the left."""
    across, down = MIDDLE - points[:, 1], MIDDLE - points[:, 0]
    dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in zip(across.tolist(), down.tolist(), strict=True))
    pen = f'stroke="{colour}" stroke-width="2.2" stroke-linecap="round" opacity="{opacity:.2f}"'
    return f'<path d="{dots}" {pen}/>'


def _values(reach: float) -> list[float]:
    step = step_of(reach)
    count = round(reach / step)
    return [number * step for number in range(-count, count + 1)]


def _squares(reach: float) -> tuple[str, str]:
    """Lines and their labels."""
    low, high = MIDDLE - HALF, MIDDLE + HALF
    lines, labels = "", ""
    for value in _values(reach):
        at = MIDDLE - value / reach * HALF
        lines += f'<path d="M{at:.1f} {low:.1f}V{high:.1f}M{low:.1f} {at:.1f}H{high:.1f}"/>'
        labels += f'<text x="{at:.1f}" y="{high + 18:.1f}" text-anchor="middle">{value:g}</text>'
        labels += f'<text x="{low - 6:.1f}" y="{at + 5:.1f}" text-anchor="end">{value:g}</text>'
    labels += f'<text x="{MIDDLE}" y="{high + 40:.1f}" text-anchor="middle">y, to the left (m)</text>'
    labels += f'<text transform="translate(18 {MIDDLE})rotate(-90)" text-anchor="middle">x, forward (m)</text>'
    return lines, labels


def _rings(reach: float) -> tuple[str, str]:
    lines, labels = "", ""
    for value in _values(reach):
        if value > 0:
            radius = value / reach * HALF
            lines += f'<circle cx="{MIDDLE}" cy="{MIDDLE}" r="{radius:.1f}"/>'
            labels += f'<text x="{MIDDLE + 4}" y="{MIDDLE - radius + 15:.1f}" fill="#777">{value:g} m</text>'
    for degrees in range(0, 360, 30):
        sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
        lines += f'<path d="M{MIDDLE} {MIDDLE}L{MIDDLE - HALF * sine:.1f} {MIDDLE - HALF * cosine:.1f}"/>'
        x, y = MIDDLE - (HALF + 18) * sine, MIDDLE - (HALF + 18) * cosine + 5
        labels += f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{degrees}°</text>'
    return lines, labels
