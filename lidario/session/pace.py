"""When the next revolution completes, so that the port is not polled earlier.

A rotor turns evenly, so the scans that came predict when the next one is complete. Until then bytes may stay in the
kernel's buffer, as long as it does not fill, and what was read of them need not be parsed. Most of the work of a
stream is waking up and parsing a few packets at a time; done once a revolution it is a fraction of that.

A prediction can be wrong, for example when the motor is told to turn faster. Then one scan comes late, by as much
as the revolution became shorter. Nothing else depends on the prediction.
"""

from __future__ import annotations

import math

from lidario.families.base import Stream
from lidario.model import Scan

__all__ = ["Pace"]

BUFFER_BYTES = 4096
"""Size of a terminal's receive buffer on Linux."""
BUFFER_SHARE = 0.55
"""Share of the buffer that may fill between two polls, as planned. The rest is reserve for polls that come late."""
LEAST_SHARE = 0.125
"""Share of the buffer below which polls are not planned closer, however late polls have come."""
LATENESS_FACTOR = 1.5
"""Safety factor on the observed lateness of polls."""
LONGEST_REST_S = 0.05
"""Longest time between two polls, however slowly bytes come: an unplugged line should be noticed soon."""
LONGEST_HOLD_S = 0.25
"""Longest time for which bytes may stay unparsed. It must stay below the watchdog's timeout, `SILENCE_S`."""
EAGER_S = 0.003
"""Latency below which a scan is not delayed for the sake of fewer polls."""
GUARD_S = 0.002
"""How much earlier than predicted a revolution may be complete: timers are late by up to a millisecond."""
_FOLLOW = 0.25
"""Share of a deviation by which the predicted period follows; more would copy the noise of a single stamp."""
_JUST_BEFORE_S = 1e-5
"""Much less than a packet takes, and more than the resolution of a clock."""
_FORGET = 0.95
"""Share of the greatest lateness that is remembered after another revolution."""
_LEAST_INTERVAL = 0.8
"""Share of a revolution's time that must have passed since the scan before."""
_NOISE = 0.03
"""Share of the period by which it may deviate as noise; beyond that the speed has changed."""


class Pace:
    """Follows the revolutions of one stream. All times are seconds of the event loop's clock.

    Args:
        stream: The stream.
        baudrate: Speed of the line in bits a second; 0 when bytes take no time.
        latency: How long a complete revolution may wait. Below `EAGER_S` a revolution is due at the first moment
            at which it can be complete; else at the first at which it most probably is, which saves polls.
        received: Bytes received before the stream began.

    Attributes:
        due: When the revolution in progress is expected to be complete; 0 when nothing is known.
    """

    def __init__(self, stream: Stream, baudrate: int, latency: float, received: int = 0) -> None:
        self.due: float = 0.0
        packet_s = stream.format.samples * stream.sample_ns * 1e-9
        wire_s = stream.format.longest * 10 / baudrate if baudrate else 0.0
        # After the packet that crosses the seam one more must arrive; where in it the crossing lies is chance.
        self._eager = latency < EAGER_S
        self._behind_s = wire_s + (1.0 if self._eager else 1.75) * packet_s
        self._period = 0.0
        self._unsteady = 0.0
        self._received = received
        self._last = math.inf
        self._buffer_s = 0.0
        self._late = 0.0

    def turned(self, scan: Scan, received: int, now: float) -> None:
        """Take note of a scan that has just come, when `received` bytes had come altogether."""
        size, self._received = received - self._received, received
        since, self._last = now - self._last, now
        self.due = 0.0
        measured = 60 / scan.rpm if scan.rpm > 0 else 0.0
        if not measured or since < _LEAST_INTERVAL * measured:
            # Scans come faster than their speed says: several late ones at once, or the device tells a wrong rate.
            return
        expected, deviation = self._period or measured, measured - self._period
        if abs(deviation) > _NOISE * expected:
            # A poll too early costs little, a poll too late delays a scan: assume the shorter period.
            expected, self._period = min(expected, measured), measured
            self._unsteady = abs(measured - expected)
        else:
            self._period += _FOLLOW * deviation
            expected = self._period
            self._unsteady = max(abs(deviation), self._unsteady / 2)
        self._buffer_s = BUFFER_BYTES * expected / size if size else 0.0
        self._late *= _FORGET
        early_s = GUARD_S + self._unsteady if self._eager else 0.0
        whole = scan.stamp_ns * 1e-9 + 2 * expected + self._behind_s
        self.due = min(whole, now + expected) - early_s

    def rest(self, now: float, late: float) -> float:
        """Seconds for which no poll is needed; 0 when the revolution may be complete.

        Args:
            now: The time.
            late: How late this poll came. In a program that blocks its loop, polls are planned closer.
        """
        self._late = max(self._late, late)
        left = self.due - now
        if left <= 0 or not self._buffer_s:
            return 0.0
        # On a very late loop keep a minimum interval: polling all the time would only make the loop later.
        cautious = max(self._buffer_s - LATENESS_FACTOR * self._late, LEAST_SHARE * self._buffer_s)
        return left / math.ceil(left / min(BUFFER_SHARE * self._buffer_s, cautious, LONGEST_REST_S))

    def hold(self, now: float) -> float:
        """Until when bytes need not be parsed: slightly before the next poll, so that this poll parses them."""
        return min(self.due, now + LONGEST_HOLD_S) - _JUST_BEFORE_S
