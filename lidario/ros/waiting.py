"""Scans of many lidars that wait for one reader: the latest few of each lidar, in the order in which they came.

Each lidar has its own room, so that many at once push out nobody's scans, and a reader that is slow sees the latest
of all of them. What is dropped is counted in the next scan of the same lidar. All together they are bounded in
bytes: how many lidars there are is for the network to say. Beyond that the oldest of all is dropped.
"""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

from lidario.scan import Scan

MOST_BYTES: Final = 64 << 20
"""Of all scans that wait: two of each of a thousand lidars."""
_SAMPLE_BYTES: Final = 9
_SCAN_BYTES: Final = 2048


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
    """Holds them, so many of each lidar.

    Attributes:
        dropped: Scans that were dropped altogether.
    """

    def __init__(self, depth: int) -> None:
        self.dropped: int = 0
        self._depth = depth
        self._order: deque[str] = deque()
        self._scans: dict[str, deque[FleetScan]] = {}
        self._size = 0

    def __len__(self) -> int:
        return len(self._order)

    def put(self, item: FleetScan) -> None:
        """Add a scan; the oldest one of its lidar gives way where there are too many."""
        held = self._scans.setdefault(item.key, deque())
        held.append(item)
        self._size += _size(item)
        if len(held) > self._depth:
            # The next one takes its place in the order.
            self._drop(item.key)
        else:
            self._order.append(item.key)
        while self._size > MOST_BYTES and len(self._order) > 1:
            self._drop(self._order.popleft())

    def take(self) -> FleetScan:
        """The oldest scan; there must be one."""
        key = self._order.popleft()
        held = self._scans[key]
        item = held.popleft()
        self._size -= _size(item)
        if not held:
            # Lidars come and go, and their number is not ours.
            del self._scans[key]
        return item

    def _drop(self, key: str) -> None:
        """Drop the oldest scan of a lidar; the next one tells what is missing."""
        held = self._scans[key]
        gone = held.popleft()
        self._size -= _size(gone)
        self.dropped += 1
        if held:
            held[0] = held[0]._replace(lost=held[0].lost + gone.lost + 1)
        else:
            del self._scans[key]


def _size(item: FleetScan) -> int:
    return len(item.key) + _SAMPLE_BYTES * len(item.scan) + _SCAN_BYTES
