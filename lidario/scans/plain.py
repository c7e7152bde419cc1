"""A scan, a sector or a message as plain numbers and lists, for JSON: `to_dict` of each.

JSON has no NaN and nothing infinite: what is not a finite number is None. Arrays become lists of numbers that are
as exact as any device sends: its finest steps are 1/64 of a degree (3e-4 rad) and 0.25 mm.
"""

import math
from collections.abc import Iterable
from typing import Any, Final

import numpy as np

UNITS: Final = {
    "angles": "rad, counter-clockwise from ahead",
    "ranges": "m",
    "range_min": "m",
    "range_max": "m",
    "max_range": "m",
    "angle_min": "rad, counter-clockwise",
    "angle_max": "rad, counter-clockwise",
    "angle_increment": "rad",
    "time_increment": "s",
    "scan_time": "s",
    "degrees": "deg",
    "rpm": "1/min",
    "reported_rpm": "1/min",
    "stamp_ns": "ns",
    "wall_stamp_ns": "ns since 1970",
    "time_increment_ns": "ns",
    "duration_ns": "ns",
}
_ARRAY_DIGITS: Final = {"angles": 6, "ranges": 5}
_DIGITS: Final = 9
"""Of a single number that is not whole: more than single precision has."""


def plain_of(record: object, names: Iterable[str]) -> dict[str, Any]:
    """Some attributes of a record by their names, and the units of those that have one, as ``units``."""
    found = {name: _plain(getattr(record, name), _ARRAY_DIGITS.get(name, _DIGITS)) for name in names}
    found["units"] = {name: UNITS[name] for name in found if name in UNITS}
    return found


def _plain(value: Any, digits: int) -> Any:
    if isinstance(value, float):
        return round(value, digits) if math.isfinite(value) else None
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.kind != "f":
        return value.tolist()
    rounded = np.round(value.astype(np.float64), digits)
    if np.isfinite(rounded).all():
        return rounded.tolist()
    return [each if math.isfinite(each) else None for each in rounded.tolist()]
