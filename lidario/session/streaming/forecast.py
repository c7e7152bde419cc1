"""When the next revolution completes, or a sector that is read, so that the port is not polled earlier.

A rotor turns evenly, so the scans that came predict when the next one is complete. Until then bytes may stay in the
kernel's buffer, as long as it does not fill, and what was read of them need not be parsed. Most of the work of a
stream is waking up and parsing a few packets at a time; done once a revolution it is a fraction of that.

A prediction can be wrong, for example when the motor is told to turn faster. Then one scan comes late, by as much
as the revolution became shorter. Nothing else depends on the prediction.
"""

import math

from lidario.families.base import Stream
from lidario.scans.scan import Scan

BITS_A_BYTE = 10
"""On a serial line with one start and one stop bit."""
BUFFER_BYTES = 4096
"""Size of a terminal's receive buffer on Linux."""
NETWORK_BUFFER_BYTES = 16 * 1024
"""What a socket surely keeps: of Linux's 208 KiB a datagram of 84 bytes takes nearly a kilobyte."""
LONGEST_BUFFER_S = 0.25
"""However slowly bytes come, a line is read at least that often: an unplugged one should be noticed soon."""
UNKNOWN_BUFFER_S = 0.04
"""Time in which the buffer may fill where not even the speed of the line is known."""
EAGER_S = 0.003
"""Latency below which a scan is not delayed for the sake of fewer polls."""
GUARD_S = 0.002
"""How much earlier than predicted a revolution may be complete: timers are late by up to a millisecond."""
AT_ONCE_S = 0.0005
"""How much earlier a revolution is polled for whose bytes come at once. They do not tell how late they were read,
and timers are never early: each poll would come later than the one before, up to a whole revolution late."""
_FOLLOW = 0.25
"""Share of a deviation by which the predicted period follows; more would copy the noise of a single stamp."""
_SECTOR_MARGIN_S = 0.001
"""How much later than predicted the port is polled for a sector: a full-speed USB adapter delivers once a
millisecond. With 0.3 ms one poll in five came too early, and the next one 4 ms later."""
_LEAST_INTERVAL = 0.8
"""Share of a revolution's time that must have passed since the scan before."""
_NOISE = 0.03
"""Share of the period by which it may deviate as noise; beyond that the speed has changed."""


class Forecast:
    """Follows the revolutions of one stream. All times are seconds of the event loop's clock.

    Args:
        stream: The stream.
        baudrate: Speed of the line in bits a second; 0 when bytes take no time.
        latency: How long a complete revolution may wait. Below `EAGER_S` a revolution is due at the first moment
            at which it can be complete; else at the first at which it most probably is, which saves polls.
        received: Bytes received before the stream began.
    """

    def __init__(self, stream: Stream, baudrate: int, latency: float, received: int = 0) -> None:
        self.latency: float = latency  # how long a complete revolution may wait
        # When the revolution in progress, or the next sector that is read, is expected to be complete; 0 when
        # nothing is known.
        self.due: float = 0.0
        # 0 where nothing is known of it, or nobody reads sectors.
        self._revolution_due = self._sector_due = 0.0
        packet_s = stream.format.samples * stream.sample_ns * 1e-9
        wire_s = stream.format.ordinary * BITS_A_BYTE / baudrate if baudrate else 0.0
        # After the packet that crosses the seam one more must arrive; where in it the crossing lies is chance.
        self._eager = latency < EAGER_S
        self._behind_s = wire_s + (1.0 if self._eager else 1.75) * packet_s
        # Whether the bytes of a revolution come at once, behind its last sample.
        self._at_once = stream.format.whole
        if self._at_once:
            self._behind_s = wire_s
        self._period = 0.0
        self._unsteady: float  # known with the period
        self._received = received
        self._last = math.inf
        # No stream is faster than its line.
        self._least_buffer_s = BUFFER_BYTES * BITS_A_BYTE / baudrate if baudrate else UNKNOWN_BUFFER_S
        self._buffer = BUFFER_BYTES if baudrate else NETWORK_BUFFER_BYTES
        self.buffer_s: float = self._least_buffer_s  # in which the system's buffer fills

    def turned(self, scan: Scan, received: int, now: float) -> None:
        """Take note of a scan that has just come, when `received` bytes had come altogether."""
        size, self._received = received - self._received, received
        since, self._last = now - self._last, now
        self._revolution_due = 0.0
        self.due = self._sector_due
        if not scan.rpm > 0:
            return
        measured = 60 / scan.rpm
        if since < _LEAST_INTERVAL * measured:
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
        # After a blocked loop all that came meanwhile counts for the first of many scans.
        if size:
            self.buffer_s = min(max(self._buffer * expected / size, self._least_buffer_s), LONGEST_BUFFER_S)
        early_s = GUARD_S + self._unsteady if self._eager else AT_ONCE_S * self._at_once
        measured_s = scan.duration_ns * 1e-9 if self._at_once else expected
        whole = scan.stamp_ns * 1e-9 + measured_s + expected + self._behind_s
        self._revolution_due = min(whole, now + expected) - early_s
        self.due = self._sector_due or self._revolution_due

    def expect(self, next_ns: float) -> None:
        """The packet that completes the next sector arrives then, in nanoseconds; NaN where that is not known."""
        self._sector_due = 0.0 if math.isnan(next_ns) else next_ns * 1e-9 + _SECTOR_MARGIN_S
        self.due = self._sector_due or self._revolution_due
