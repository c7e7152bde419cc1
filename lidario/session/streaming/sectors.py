"""Sectors on their way to their readers, and when the port is polled for them.

A reader of sectors is a reader of the stream like any other (`ScanStream`): its mailbox says into how
many sectors it wants a revolution divided.
"""

from __future__ import annotations

import math

from lidario.arguments import finite, shown
from lidario.errors import InvalidValue
from lidario.revolution.sectors import MOST_PARTS
from lidario.sector import Sector
from lidario.session.streaming.pace import LONGEST_HOLD_S, Pace
from lidario.session.streaming.stream import ReaderStream

DEFAULT_DEGREES = 45.0
_WHOLE = 1e-6
"""Difference from a whole number of sectors that is only rounding."""
_MARGIN_S = 0.001
"""How much later than predicted the port is polled for a sector: a full-speed USB adapter delivers once a
millisecond. With 0.3 ms one poll in five came too early, and the next one 4 ms later."""
_JUST_BEFORE_S = 1e-5


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


class SectorPace(Pace):
    """As `Pace`, and for those who read sectors: the port is polled when the next sector is complete.

    Args:
        other: What has followed the revolutions so far, and is not used any more. This one goes on where it stands.

    Attributes:
        sector_due: When that is expected; 0 where nothing is known, so that only the revolution counts.
    """

    def __init__(self, other: Pace) -> None:
        vars(self).update(vars(other))
        self.sector_due: float = 0.0

    def expect(self, next_ns: float) -> None:
        """The packet that completes the next sector arrives then, in nanoseconds; NaN where that is not known."""
        self.sector_due = 0.0 if math.isnan(next_ns) else next_ns * 1e-9 + _MARGIN_S

    def rest(self, now: float) -> float:
        if not self.sector_due:
            return super().rest(now)
        return max(0.0, min(self.sector_due - now, LONGEST_HOLD_S))

    def hold(self, now: float) -> float:
        if not self.sector_due:
            return super().hold(now)
        return min(self.sector_due, now + LONGEST_HOLD_S) - _JUST_BEFORE_S


class SectorStream(ReaderStream[Sector]):
    """An asynchronous iterator of parts of revolutions; made by `Lidar.sectors`.

    It begins, ends and fails as a `ScanStream` does, in ``async for`` and ``async with``. The first sectors are
    those of the first revolution that is seen from its beginning.

    Cancelling ``__anext__`` loses no sector, and does not end the stream.
    """

    _instead = "sectors come asynchronously: write `async for sector in lidar.sectors():`"
