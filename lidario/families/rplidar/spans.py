"""Headings that are out of place among those of nodes: what they seem to be missing is not."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["correct_leaps", "ignore_falls"]

FALSE_PACKETS: Final = 40
"""Packets within which a leap and a fall belong together: between them stands what was no packet."""


def correct_leaps(missing: NDArray[np.intp], spans: NDArray[np.float64], typical: float) -> None:
    """Where headings leap ahead and soon fall back, only the difference is missing."""
    for fall in np.flatnonzero(spans < -2 * typical).tolist():
        leaps = np.flatnonzero(missing[max(0, fall - FALSE_PACKETS) : fall] > 0)
        if len(leaps):
            leap = max(0, fall - FALSE_PACKETS) + int(leaps[-1])
            missing[leap] = max(0, int(missing[leap]) + round(float(spans[fall]) / typical))


def ignore_falls(missing: NDArray[np.intp], spans: NDArray[Any]) -> None:
    """A leap beside a fall is one heading that is out of place, not a gap."""
    falls = spans < 0
    missing[1:][falls[:-1]] = -1
    missing[:-1][falls[1:]] = -1
