"""Sectors on their way to their readers, and when the port is polled for them.

A reader of sectors is a reader of the stream like any other (`ScanStream`): its mailbox says into how
many sectors it wants a revolution divided.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from lidario.arguments import finite, shown
from lidario.errors import InvalidValue
from lidario.revolution.sectors import MOST_PARTS
from lidario.scan import Scan
from lidario.sector import Sector
from lidario.session.streaming.pace import LONGEST_HOLD_S, Pace
from lidario.session.streaming.stream import ReaderStream

__all__ = ["DEFAULT_DEGREES", "SectorPace", "SectorStream", "parts_of", "sectors_of"]

DEFAULT_DEGREES = 45.0
_WHOLE = 1e-6
"""Difference from a whole number of sectors that is only rounding."""
_MARGIN_S = 0.0003
"""How much later than predicted the port is polled for a sector: what the least delayed delivery takes longer."""
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


def sectors_of(scan: Scan, parts: int) -> Iterator[Sector]:
    """A scan that came whole, from another machine, in so many parts; the first one tells its lost packets."""
    count = len(scan)
    away = math.copysign(1.0, scan.field_of_view) * (scan.device_angles.astype(np.float64) - scan.seam) % 360.0
    index = np.minimum((away * (parts / 360.0)).astype(np.intp), parts - 1)
    # Corrected angles may stand before the seam, or fall back over the end of a sector.
    index[: count // 4][index[: count // 4] > parts // 2] = 0
    index = np.maximum.accumulate(index)
    bounds = np.searchsorted(index, np.arange(parts + 1)).tolist()
    ends_ns = [*scan.times_ns.tolist(), scan.stamp_ns + scan.duration_ns]
    lost = scan.lost_packets
    for number, (begin, end) in enumerate(pairwise(bounds)):
        if begin == end:
            continue
        yield Sector(
            device_angles=scan.device_angles[begin:end],
            device_distances=scan.device_distances[begin:end],
            intensities=None if scan.intensities is None else scan.intensities[begin:end],
            stamp_ns=ends_ns[begin],
            wall_stamp_ns=scan.wall_stamp_ns + ends_ns[begin] - scan.stamp_ns,
            time_increment_ns=scan.time_increment_ns,
            duration_ns=ends_ns[end] - ends_ns[begin],
            rpm=scan.rpm,
            seq=scan.seq,
            index=number,
            degrees=360.0 / parts,
            dropped_before=0,
            lost_packets=lost,
            mode=scan.mode,
            max_range=scan.max_range,
            field_of_view=scan.field_of_view,
        )
        lost = 0


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
