"""The picture of the filters in the documentation: a scan of the simulated room, and what each one takes out.

The body of a robot, veiling points at edges and single points are added to the room, which has none of them.
"""

from __future__ import annotations

import numpy as np

from lidario import Scan
from lidario.filters import BoxFilter, Filter, RadiusOutlierFilter, ShadowsFilter
from lidario.sim.rooms import make_world
from lidario.testing import make_scan

__all__ = ["SIZE", "filters_page"]

SIZE = (1180, 420)
_SAMPLES = 1440
_SCALE = 43.0
_PANELS: tuple[tuple[str, Filter], ...] = (
    ("BoxFilter: the robot's body", BoxFilter(-0.55, 0.45, -0.45, 0.45)),
    ("ShadowsFilter: veiling points", ShadowsFilter()),
    ("RadiusOutlierFilter: speckles", RadiusOutlierFilter(0.2)),
)


def filters_page(*, dark: bool) -> str:
    """The page as HTML: three panels, with what is taken out in red."""
    ground, ink, kept = ("#111316", "#edeef0", "#7fb0ff") if dark else ("#fafafa", "#1c2024", "#1b5fc1")
    scan = _spoilt_room()
    panels = "".join(_panel(scan, words, each, kept) for words, each in _PANELS)
    style = (
        f"body{{margin:0;background:{ground};color:{ink};display:flex;font:600 16px system-ui,sans-serif}}"
        "figure{margin:8px 10px;text-align:center}svg{display:block}"
    )
    return f"<style>{style}</style>{panels}"


def _panel(scan: Scan, words: str, each: Filter, kept: str) -> str:
    made, xy = scan.filtered(each), scan.xy()
    dots = []
    for mask, colour, radius in ((made.valid, kept, 1.1), (made.left_out & scan.valid, "#e5484d", 2.6)):
        for x, y in xy[mask].tolist():
            dots.append(f"<circle cx='{-y * _SCALE:.1f}' cy='{-x * _SCALE:.1f}' r='{radius}' fill='{colour}'/>")
    robot = "<path d='M0-8 6 7 0 3-6 7z' fill='currentColor'/>"
    return (
        f"<figure><svg width='370' height='370' viewBox='-170 -230 370 370'>{''.join(dots)}{robot}</svg>"
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
    for at in chance.choice(_SAMPLES, 14, replace=False).tolist():
        metres[at] = chance.uniform(0.3, 0.85) * metres[at]
    return make_scan(-np.radians(degrees), np.where(metres > 0, metres, np.nan))
