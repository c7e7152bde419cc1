"""When bytes came that were collected from several reads, and what was known of them at that time.

Behind damage, the bytes that follow decide whether something is a packet. So one may be complete with one read, and
told only with the next. Who gets both reads joined must not know more: the packets before it were dated without it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

from lidario.wire.copies import copy_of
from lidario.wire.events import Arrival
from lidario.wire.formats import StreamFormat


class ArrivedBytes(list[Arrival]):
    """Which bytes had come when. They are counted from the first one ever fed, so they stay right in any buffer."""

    def keep(self, begin: int, fed: int, now: int) -> None:
        """So many bytes were fed, the last one now; those before `begin` are understood."""
        self[:] = [each for each in (*self, (fed, now)) if each[0] > begin]

    def of(self, offsets: Sequence[int], begin: int, now: int) -> tuple[Arrival, ...]:
        """How many packets had come when; `offsets` (`packet_offsets`) count from `begin` in all that was fed."""
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
        """How many bytes had been fed when all of this time had come: some had, and more came later."""
        return max(size for size, came_ns in self if came_ns <= at_ns)


def finds_packets(wire: StreamFormat, before: dict[str, Any], shown: bytearray) -> bool:
    """Whether a search for packets behind damage finds one in the bytes that were `shown` at an earlier time.

    `before` has the fields of the format as they were when the search began.
    """
    wire = copy_of(wire)
    vars(wire).update(before)
    return wire.packets_in(shown)[0] > 0
