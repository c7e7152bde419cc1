"""Sectors on their way to their readers.

A reader of sectors is a reader of the stream like any other (`ScanStream`): its mailbox says into how
many sectors it wants a revolution divided.
"""

from __future__ import annotations

import math

from lidario.arguments import finite, shown
from lidario.errors import InvalidValue
from lidario.revolution.sectors import MOST_PARTS
from lidario.sector import Sector
from lidario.session.streaming.stream import ReaderStream

DEFAULT_DEGREES = 45.0
_WHOLE = 1e-6
"""Difference from a whole number of sectors that is only rounding."""


def parts_of(degrees: float) -> int:
    """How many sectors of that size a revolution has.

    Raises:
        InvalidValue: 360 degrees are no whole number of them, or they are smaller than 5 degrees.
    """
    try:
        parts = 360.0 / finite(degrees, "the size of a sector")
        whole = round(parts)
    except (ValueError, ZeroDivisionError, OverflowError):
        whole, parts = 0, math.nan
    if not 1 <= whole <= MOST_PARTS or not abs(parts - whole) <= _WHOLE * whole:
        raise InvalidValue(
            f"a sector has at least {360 // MOST_PARTS} degrees, and 360 is a multiple of it; "
            f"not so {shown(degrees)}"
        )
    return whole


class SectorStream(ReaderStream[Sector]):
    """An asynchronous iterator of parts of revolutions; made by `Lidar.sectors`.

    It begins, ends and fails as a `ScanStream` does, in ``async for`` and ``async with``. The first sectors are
    those of the first revolution that is seen from its beginning.

    Cancelling ``__anext__`` loses no sector, and does not end the stream.
    """

    _instead = "sectors come asynchronously: write `async for sector in lidar.sectors():`"
