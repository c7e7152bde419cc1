"""What the page is sent: a scan as bytes, and everything else as a small JSON text.

A scan, little-endian; the arrays stand one behind the other, each of as many values as there are samples:

======  =======  ==============================================================
offset  type     what
======  =======  ==============================================================
0       uint8    1: the kind of the message
1       uint8    number of the lidar
2       uint16   1 where intensities follow, else 0
4       uint32   number of samples
8       float64  when the revolution ended, milliseconds since the Unix epoch
16      uint32   `Scan.seq`, its lower 32 bits
20      float32  revolutions a second, 0 where they are not known
24      uint32   packets lost in this revolution
28      uint32   0
32      uint16   angles, counter-clockwise, 65536 to the revolution
…       uint16   ranges in millimetres; 0 without a return, 65535 from there on
…       uint8    intensities
======  =======  ==============================================================

A scan of 3200 samples takes 12.8 kB, or 16 kB with intensities: angles and distances finer than a screen shows.
"""

import json
import math
import struct
import time
from collections.abc import Sequence
from typing import Final

import numpy as np

from lidario import Scan
from lidario.filters import AngularBoundsFilter, BoxFilter, Filter
from lidario.web.feed import Feed

SCAN: Final = 1
HEADER: Final = struct.Struct("<BBHIdIfII")
_FARTHEST: Final = 0xFFFF
_REASON: Final = 200
"""Longest reason that is sent; the text of an error may have any length."""


def pack_scan(number: int, scan: Scan) -> bytes:
    """The bytes of a scan of lidar `number`."""
    # Degrees clockwise, below 360: the sum is above 0, and its remainder is the angle counter-clockwise.
    angles = np.rint((360.0 - scan.device_angles) * (65536.0 / 360.0)).astype(np.uint32).astype("<u2")
    ranges = np.rint(np.clip(scan.device_distances, 0, _FARTHEST)).astype("<u2")
    head = HEADER.pack(
        SCAN,
        number,
        scan.intensities is not None,
        len(scan),
        (scan.wall_stamp_ns + scan.duration_ns) / 1e6,
        scan.seq & 0xFFFFFFFF,
        scan.rpm / 60 if math.isfinite(scan.rpm) else 0.0,
        scan.lost_packets,
        0,
    )
    parts = [head, angles.tobytes(), ranges.tobytes()]
    if scan.intensities is not None:
        parts.append(scan.intensities.tobytes())
    return b"".join(parts)


def pack_state(feeds: list[Feed], echo: float | None = None, masks: dict[str, object] | None = None) -> str:
    """The states of all lidars as JSON, and of the masks; `echo` is a viewer's own time, to compare clocks."""
    lidars = [
        {
            "source": feed.source,
            "model": feed.info.model if feed.info else "",
            "serial": feed.info.serial if feed.info else "",
            "mode": feed.latest.mode if feed.latest else "",
            "state": feed.state,
            "reason": feed.reason[:_REASON],
            "damaged": None if feed.line is None else round(feed.line.damaged, 5),
            "load": None if feed.line is None or feed.line.load is None else round(feed.line.load, 3),
            "x": feed.place.x,
            "y": feed.place.y,
            "yaw": round(math.degrees(feed.place.yaw), 6),
            "colour": feed.colour,
            "play": _play(feed),
            "record": _record(feed),
            "shapes": _shapes_of(feed.filters),
        }
        for feed in feeds
    ]
    state = {"now": time.time() * 1000, "echo": echo, "lidars": lidars, "masks": masks}
    return json.dumps(state, allow_nan=False)


def _play(feed: Feed) -> dict[str, float] | None:
    if not feed.length_s:
        return None
    return {"at": round(feed.reached_s, 2), "length": round(feed.length_s, 2), "rate": feed.rate}


def _record(feed: Feed) -> dict[str, object] | None:
    if feed.keeper is None:
        return None
    keeper = feed.keeper
    return {
        "on": keeper.is_on,
        "name": keeper.name,
        "scans": keeper.scans,
        "whole": keeper.is_whole,
        "error": keeper.error[:_REASON],
    }


def _shapes_of(filters: Sequence[Filter]) -> list[list[float]]:
    """Among filters, the boxes (four sides, metres of the robot) and left-out sectors (two angles, radians)."""
    shapes: list[list[float]] = []
    for each in filters:
        if isinstance(each, BoxFilter) and not each.invert:
            shapes.append([each.min_x, each.max_x, each.min_y, each.max_y])
        elif isinstance(each, AngularBoundsFilter) and each.invert:
            shapes += [[begin, end] for begin, end in each.windows]
    return shapes
