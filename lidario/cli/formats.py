"""A scan as text: a JSON line or CSV rows for programs, a line of a table for people.

The names are those of `lidario.Scan`, and so are the units: radians counter-clockwise from forward, metres. A
sample without a return is ``null`` in JSON and an empty field in CSV; never 0, and never NaN, which JSON lacks.
"""

from __future__ import annotations

import json
import math
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

import lidario

_ANGLE_DIGITS = 6
_RANGE_DIGITS = 5
"""As in `lidario.scans.plain`."""

CSV_HEADER = "seq,wall_stamp_ns,angle_rad,range_m,intensity\n"
ROW_HEADER = "scan samples  returns   rpm     Hz        nearest       farthest  lost  dropped\n"


def as_json(scan: lidario.Scan) -> str:
    """One line."""
    return json.dumps(scan.to_dict(), separators=(",", ":"), allow_nan=False) + "\n"


def as_csv(scan: lidario.Scan) -> str:
    """One row per sample, with the time at which it was measured; each begins with the number of the scan."""
    stamps = scan.times_ns + (scan.wall_stamp_ns - scan.stamp_ns)
    columns: list[NDArray[Any]] = [stamps, scan.angles, np.where(scan.valid, scan.ranges, np.nan)]
    row = f"{scan.seq},%d,%.{_ANGLE_DIGITS}f,%.{_RANGE_DIGITS}f,"
    if scan.intensities is not None:
        columns.append(scan.intensities)
        row += "%d"
    # All rows in one go: it takes half as long as one by one.
    values = tuple(chain.from_iterable(zip(*(column.tolist() for column in columns), strict=True)))
    return (f"{row}\n" * len(scan) % values).replace(",nan,", ",,")


def as_row(scan: lidario.Scan) -> str:
    """A line under `ROW_HEADER`, 79 columns wide."""
    hits = int(np.count_nonzero(scan.valid))
    share = f"{hits / len(scan):.1%}" if len(scan) else "-"
    turning = math.isfinite(scan.rpm)
    nearest = farthest = "-"
    if hits:
        nearest = _beam(scan, int(np.nanargmin(scan.ranges)))
        farthest = _beam(scan, int(np.nanargmax(scan.ranges)))
    return (
        f"{scan.seq:>4}  {len(scan):>6}  {share:>7}  {f'{scan.rpm:.0f}' if turning else '-':>4}  "
        f"{f'{scan.rpm / 60:.2f}' if turning else '-':>5}  {nearest:>13}  {farthest:>13}  "
        f"{scan.lost_packets:>4}  {scan.dropped_before:>7}\n"
    )


def _beam(scan: lidario.Scan, index: int) -> str:
    degrees = round(math.degrees(scan.angles[index]))  # an integer, so that it is never printed as -0°
    return f"{scan.ranges[index]:.2f} m {degrees:+d}°"
