"""Every argument of every filter as a call with one value, for `tests/basics/test_arguments.py`."""

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any

from lidario import Scan, filters

_CORNERS = [(0.0, 1.0), (1.0, 0.0), (0.0, 0.0)]


def filter_calls(scan: Scan) -> dict[str, Callable[[Any], object]]:
    """By name, such as ``RangeFilter(lower_threshold)``: makes the filter, and calls it with this scan."""
    names = [name for name in filters.__all__ if name not in ("Filter", "MaskFilter")]
    return {
        f"{name}({argument})": partial(_called, getattr(filters, name), argument, scan)
        for name in names
        for argument in inspect.signature(getattr(filters, name)).parameters
    }


def _called(make: Callable[..., Callable[[Scan], Scan]], argument: str, scan: Scan, value: object) -> object:
    given: dict[str, object] = {
        each.name: 0 if each.name.startswith(("min_", "max_")) else _CORNERS
        for each in inspect.signature(make).parameters.values()
        if each.default is inspect.Parameter.empty
    }
    return make(**given | {argument: value})(scan)
