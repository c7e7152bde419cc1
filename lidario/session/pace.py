"""When a turn will be complete: while it cannot be, nobody need look at the port.

A rotor turns evenly, so the scans that came tell when the next will be whole. Until then bytes may lie in the
kernel's buffer, as long as it does not fill, and what was read of them may lie uncut in `Link`. Waking up and
cutting packets is most of the work there is; done once a turn it is a fraction of it.

A prediction can be wrong, when the motor is told to turn faster, say. Then a scan comes late by as much as the turn
was shorter, once; nothing else depends on it.
"""

from __future__ import annotations

import math

from lidario.families.base import Stream
from lidario.model import Scan

__all__ = ["Pace"]

BUFFER_BYTES = 4096
"""What a terminal's buffer holds, on Linux."""
BUFFER_SHARE = 0.55
"""Share of it that may fill between two looks, as planned; the rest is there for looks that come late."""
LEAST_SHARE = 0.125
"""Share that may fill however late looks have come."""
WARY = 1.5
"""A look may come as late as looks came lately, and half as late again."""
LONGEST_REST_S = 0.05
"""Longest time between two looks, however slowly bytes come: a line that was pulled should be noticed."""
LONGEST_HOLD_S = 0.25
"""Longest time for which packets may lie uncut: those who watch whether any come must not be misled."""
EAGER_S = 0.003
"""Latency below which no look is saved at the price of a delay."""
GUARD_S = 0.002
"""How much earlier than predicted a turn may be complete: timers are late by up to a millisecond."""
_FOLLOW = 0.25
"""Share of a surprise by which the period follows; more would pass the noise of one scan's stamp on."""
_HAIR_S = 1e-5
"""Far less than a packet takes, and more than a clock is read wrong by."""
_FORGET = 0.95
"""What is left of the greatest lateness after another turn."""
_TOLD = 0.8
"""Part of a turn's time that must have gone by since the scan before."""
_SURPRISED = 0.03
"""Part of a period that is no noise: the speed has changed."""


class Pace:
    """Follows the turns of one stream. All times are seconds of the event loop's clock.

    Args:
        stream: The stream.
        baudrate: Speed of the line in bits a second; 0 when bytes take no time.
        latency: How long a whole turn may wait. Where that is next to nothing, the turn is due at the first moment
            at which it may be whole; else at the first at which it most probably is, which saves looks.
        received: Bytes received before the stream began.

    Attributes:
        due: When the turn in progress is expected to be whole; 0 when nothing is known.
    """

    def __init__(self, stream: Stream, baudrate: int, latency: float, received: int = 0) -> None:
        self.due: float = 0.0
        packet_s = stream.format.samples * stream.sample_ns * 1e-9
        wire_s = stream.format.longest * 10 / baudrate if baudrate else 0.0
        # Behind the packet that crosses the seam one more must arrive; where in it the crossing lies is chance.
        self._eager = latency < EAGER_S
        self._behind_s = wire_s + (1.0 if self._eager else 1.75) * packet_s
        self._period = 0.0
        self._unsteady = 0.0
        self._received = received
        self._last = math.inf
        self._buffer_s = 0.0
        self._late = 0.0

    def turned(self, scan: Scan, received: int, now: float) -> None:
        """Take note of a scan that has just come, of `received` bytes altogether."""
        size, self._received = received - self._received, received
        since, self._last = now - self._last, now
        self.due = 0.0
        measured = 60 / scan.rpm if scan.rpm > 0 else 0.0
        if not measured or since < _TOLD * measured:
            # Scans come faster than by their own account: late ones all at once, or the device's rate is wrong.
            return
        expected, surprise = self._period or measured, measured - self._period
        if abs(surprise) > _SURPRISED * expected:
            # Better look too early than too late, whichever way the speed has changed.
            expected, self._period = min(expected, measured), measured
            self._unsteady = abs(measured - expected)
        else:
            self._period += _FOLLOW * surprise
            expected = self._period
            self._unsteady = max(abs(surprise), self._unsteady / 2)
        self._buffer_s = BUFFER_BYTES * expected / size if size else 0.0
        self._late *= _FORGET
        early_s = GUARD_S + self._unsteady if self._eager else 0.0
        whole = scan.stamp_ns * 1e-9 + 2 * expected + self._behind_s
        self.due = min(whole, now + expected) - early_s

    def rest(self, now: float, late: float) -> float:
        """Seconds for which nobody need look at the port; 0 when the turn may be whole.

        Args:
            now: The time.
            late: How long after its time this look came. A program that blocks its loop is looked after more often.
        """
        self._late = max(self._late, late)
        left = self.due - now
        if left <= 0 or not self._buffer_s:
            return 0.0
        # Where even that would not do, looking all the time would only make the program later still.
        cautious = max(self._buffer_s - WARY * self._late, LEAST_SHARE * self._buffer_s)
        return left / math.ceil(left / min(BUFFER_SHARE * self._buffer_s, cautious, LONGEST_REST_S))

    def hold(self, now: float) -> float:
        """Until when packets may lie uncut: a hair less than one rests, so that the look that is due cuts them."""
        return min(self.due, now + LONGEST_HOLD_S) - _HAIR_S
