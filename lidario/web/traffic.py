"""What the line carried between two snapshots of the counters: damage, losses and load, as shares.

For the command too, which must not load numpy for it, as `lidario.web.feed` does.
"""

import math
from dataclasses import dataclass, fields
from typing import Final

from lidario import Stats

BITS_A_BYTE: Final = 10
"""On a serial line: a start bit, eight data bits, a stop bit."""
_MOST_LOAD: Final = 1.1
"""A full line, and the unevenness of what is read of it."""


@dataclass(frozen=True, slots=True)
class Traffic(Stats):
    """The line during some seconds: the counters of that time, and two rates."""

    bytes_a_second: float = 0.0  # bytes received a second
    # Share of what the line can carry, 0 to 1. None where the line has no speed, or carries more than that speed
    # allows: a lidar that is a USB device itself has none, whatever the port is set to.
    load: float | None = None

    @property
    def damaged(self) -> float:
        """Share of the packets that were damaged or lost, 0 to 1."""
        return self.lost_packets / max(self.packets + self.lost_packets, 1)


def traffic(before: Stats, after: Stats, seconds: float, baudrate: int) -> Traffic:
    """What came between two snapshots that were taken so many seconds apart; `baudrate` 0 is no speed."""
    counted = {each.name: getattr(after, each.name) - getattr(before, each.name) for each in fields(Stats)}
    rate = counted["bytes_received"] / max(seconds, 1e-9)
    load = rate * BITS_A_BYTE / baudrate if baudrate else math.inf
    return Traffic(**counted, bytes_a_second=rate, load=load if load <= _MOST_LOAD else None)
