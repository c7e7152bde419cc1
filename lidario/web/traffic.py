"""What the line carried between two snapshots of the counters: damage, losses and load, as shares."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from lidario import Stats

__all__ = ["Traffic", "traffic"]

BITS_A_BYTE: Final = 10
"""On a serial line: a start bit, eight data bits, a stop bit."""
_MOST_LOAD: Final = 1.1
"""A full line, and the unevenness of what is read of it."""


@dataclass(frozen=True, slots=True)
class Traffic:
    """The line during some seconds.

    Attributes:
        packets: Intact packets.
        lost_packets: Packets that were damaged or lost on the line.
        missed_scans: Revolutions of which so much was missing that no scan was made.
        dropped_scans: Scans that slow readers of this session missed.
        skipped_bytes: Bytes of a stream that belong to no packet.
        discarded_bytes: Bytes that were thrown away because this program was too slow.
        late_reads: Reads that came so late that bytes may have been lost before them.
        framing_errors: As `lidario.Stats.framing_errors`.
        parity_errors: As `lidario.Stats.parity_errors`.
        overruns: As `lidario.Stats.overruns`.
        breaks: As `lidario.Stats.breaks`.
        bytes_a_second: Bytes received a second.
        load: Share of what the line can carry, 0 to 1. None where the line has no speed, or carries more than that
            speed allows: a lidar that is a USB device itself has none, whatever the port is set to.
    """

    packets: int
    lost_packets: int
    missed_scans: int
    dropped_scans: int
    skipped_bytes: int
    discarded_bytes: int
    late_reads: int
    framing_errors: int
    parity_errors: int
    overruns: int
    breaks: int
    bytes_a_second: float
    load: float | None

    @property
    def damaged(self) -> float:
        """Share of the packets that were damaged or lost, 0 to 1."""
        return self.lost_packets / max(self.packets + self.lost_packets, 1)

    @property
    def trouble(self) -> str:
        """What the driver has counted, with what it is mostly a sign of; empty where it has counted nothing."""
        return Stats(
            framing_errors=self.framing_errors,
            parity_errors=self.parity_errors,
            overruns=self.overruns,
            breaks=self.breaks,
        ).line_trouble


def traffic(before: Stats, after: Stats, seconds: float, baudrate: int) -> Traffic:
    """What came between two snapshots that were taken so many seconds apart; `baudrate` 0 is no speed."""
    rate = (after.bytes_received - before.bytes_received) / max(seconds, 1e-9)
    load = rate * BITS_A_BYTE / baudrate if baudrate else math.inf
    return Traffic(
        packets=after.packets - before.packets,
        lost_packets=after.lost_packets - before.lost_packets,
        missed_scans=after.missed_scans - before.missed_scans,
        dropped_scans=after.dropped_scans - before.dropped_scans,
        skipped_bytes=after.skipped_bytes - before.skipped_bytes,
        discarded_bytes=after.discarded_bytes - before.discarded_bytes,
        late_reads=after.late_reads - before.late_reads,
        framing_errors=after.framing_errors - before.framing_errors,
        parity_errors=after.parity_errors - before.parity_errors,
        overruns=after.overruns - before.overruns,
        breaks=after.breaks - before.breaks,
        bytes_a_second=rate,
        load=load if load <= _MOST_LOAD else None,
    )
