"""Scans of many lidars that wait for one reader: the latest few of each lidar, in the order in which they came.

Each lidar has its own room, so that many at once push out nobody's scans, and a reader that is slow sees the latest
of all of them. What is dropped is counted in the next scan of the same lidar.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from lidario.scan import Scan

__all__ = ["FleetScan", "WaitingScans"]


class FleetScan(NamedTuple):
    """One scan of one lidar.

    Attributes:
        key: Which lidar.
        scan: The scan.
        sent_ns: When it was sent, nanoseconds since the Unix epoch, by the clock of its publisher; 0 where it does
            not say.
        lost: Messages of this lidar that are missing since the scan before: lost on the way, or dropped here
            because the reader was slow. A message is a scan; of raw bytes, a part of one.
    """

    key: str
    scan: Scan
    sent_ns: int
    lost: int


class WaitingScans:
    """Holds them.

    Args:
        depth: Scans of one lidar that are kept.

    Attributes:
        dropped: Scans that were dropped altogether.
    """

    def __init__(self, depth: int) -> None:
        self.dropped: int = 0
        self._depth = depth
        self._order: deque[str] = deque()
        self._scans: dict[str, deque[FleetScan]] = {}

    def __len__(self) -> int:
        return len(self._order)

    def put(self, item: FleetScan) -> None:
        """Add a scan; the oldest one of its lidar gives way where there are too many."""
        held = self._scans.setdefault(item.key, deque())
        held.append(item)
        if len(held) <= self._depth:
            self._order.append(item.key)
            return
        # The next one takes its place in the order, and tells what is missing.
        gone = held.popleft()
        held[0] = held[0]._replace(lost=held[0].lost + gone.lost + 1)
        self.dropped += 1

    def take(self) -> FleetScan:
        """The oldest scan; there must be one."""
        key = self._order.popleft()
        held = self._scans[key]
        item = held.popleft()
        if not held:
            # Lidars come and go, and their number is not ours.
            del self._scans[key]
        return item
