"""The picture of the filters in the documentation: a scan of the simulated room, and what each one takes out.

The body of a robot, veiling points at edges and single points are added to the room, which has none of them.
"""

from __future__ import annotations

import numpy as np

from lidario import Scan
from lidario.filters import (
    AngularBoundsFilter,
    BoxFilter,
    Filter,
    IntensityFilter,
    MedianFilter,
    PolygonFilter,
    RadiusOutlierFilter,
    RangeFilter,
    ShadowsFilter,
)
from lidario.sim.rooms import make_world
from lidario.testing import make_scan

SIZE = (1180, 660)
_SAMPLES = 1440
_SCALE = 33.0
_MOVED_M = 0.05
_PANELS: tuple[tuple[str, Filter], ...] = (
    ("BoxFilter: the robot's body", BoxFilter(-0.55, 0.45, -0.45, 0.45)),
    ("PolygonFilter: an area", PolygonFilter([(4.0, 0.9), (9.0, 3.5), (9.0, -9.0), (4.0, -9.0)])),
    ("AngularBoundsFilter: a sector", AngularBoundsFilter([(2.0, 2.6)], invert=True)),
    ("RangeFilter: beyond 4 m", RangeFilter(0.0, 4.0)),
    ("IntensityFilter: weak returns", IntensityFilter(40)),
    ("ShadowsFilter: veiling points", ShadowsFilter()),
    ("RadiusOutlierFilter: speckles", RadiusOutlierFilter(0.2)),
    ("MedianFilter: moves them", MedianFilter(5)),
)


def filters_page(*, dark: bool) -> str:
    """The page as HTML: a panel for each filter, with what it takes out, or moves, in red."""
    ground, ink, kept = ("#111316", "#edeef0", "#7fb0ff") if dark else ("#fafafa", "#1c2024", "#1b5fc1")
    scan = _spoilt_room()
    panels = "".join(_panel(scan, words, each, kept) for words, each in _PANELS)
    style = (
        f"body{{margin:0;background:{ground};color:{ink};font:600 15px system-ui,sans-serif}}"
        "body{display:flex;flex-wrap:wrap}"
        "figure{margin:6px 5px;text-align:center}svg{display:block}"
    )
    return f"<style>{style}</style>{panels}"


def _panel(scan: Scan, words: str, each: Filter, kept: str) -> str:
    made = scan.filtered(each)
    gone = scan.valid & (made.left_out | (abs(made.ranges - scan.ranges) > _MOVED_M))
    dots = []
    for xy, colour, radius in ((made.xy()[made.valid], kept, 1.0), (scan.xy()[gone], "#e5484d", 2.4)):
        for x, y in xy.tolist():
            dots.append(f"<circle cx='{-y * _SCALE:.1f}' cy='{-x * _SCALE:.1f}' r='{radius}' fill='{colour}'/>")
    robot = "<path d='M0-8 6 7 0 3-6 7z' fill='currentColor'/>"
    return (
        f"<figure><svg width='285' height='285' viewBox='-131 -177 285 285'>{''.join(dots)}{robot}</svg>"
        f"<figcaption>{words}</figcaption></figure>"
    )


def _spoilt_room() -> Scan:
    chance = np.random.default_rng(5)
    degrees = np.arange(_SAMPLES) * 360.0 / _SAMPLES
    metres = make_world("room", seed=2).ranges_mm(degrees, np.full(_SAMPLES, 6.0)) / 1000.0
    for at in np.flatnonzero(np.abs(np.diff(metres)) > 0.5).tolist():
        near, far = metres[at], metres[at + 1]
        if near > 0 and far > 0:
            metres[at + (far > near)] = near + (far - near) * chance.uniform(0.25, 0.75)
    for post in (130.0, 230.0):
        metres[np.abs(degrees - post) < 7] = 0.5
    strengths = np.full(_SAMPLES, 120)
    for at in chance.choice(_SAMPLES, 14, replace=False).tolist():
        metres[at] = chance.uniform(0.3, 0.85) * metres[at]
        strengths[at] = 20
    found = np.where(metres > 0, metres, np.nan)
    return make_scan(-np.radians(degrees), found, intensities=strengths)
