"""Keeps when bytes came that were collected from several reads, and what was known of them at that time.

Behind damage, the bytes that follow decide whether something is a packet. So a packet may be complete with one
read, and be recognised only with the next. The result must be the same if both reads are given joined: there, too,
the packets before it are dated as if it were not known yet.
"""

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

from lidario.wire.copies import copy_of
from lidario.wire.events import Arrival
from lidario.wire.formats import StreamFormat


class ArrivedBytes(list[Arrival]):
    """How many bytes had come at which time, counted from the first byte ever fed: so it is right in any buffer."""

    def keep(self, begin: int, fed: int, now: int) -> None:
        """Note that `fed` bytes had come at `now`; forget reads that end before `begin`: their bytes are parsed."""
        self[:] = [each for each in (*self, (fed, now)) if each[0] > begin]

    def of(self, offsets: Sequence[int], begin: int, now: int) -> tuple[Arrival, ...]:
        """How many packets had come at which time; `offsets` (`packet_offsets`) count from byte `begin` on."""
        found: list[Arrival] = []
        done, count = 0, len(offsets) - 1
        for fed, at_ns in self:
            complete = bisect_right(offsets, fed - begin) - 1
            if complete > done:
                found.append((complete, at_ns))
                done = complete
        if done < count:
            found.append((count, now))
        return tuple(found)

    def last_until(self, at_ns: int) -> int:
        """How many bytes had come until `at_ns`; at least one read had."""
        return max(size for size, came_ns in self if came_ns <= at_ns)


def finds_packets(wire: StreamFormat, before: dict[str, Any], shown: bytearray) -> bool:
    """Whether a search behind damage finds a packet in the bytes `shown`, which had come at an earlier time.

    `before` has the fields of the format as they were when the search began.
    """
    wire = copy_of(wire)
    vars(wire).update(before)
    return wire.packets_in(shown)[0] > 0
