"""When the first sample of a revolution was measured.

A packet arrives after its last sample was measured: by the time its bytes take on the wire, plus a sample and a
half in the device (vendor's SDK 2.1.0 for one family, adopted for all), and then by whatever the adapter, the
kernel and the event loop add. The device's own clock is even. So every packet of a revolution gives an estimate of
when the revolution began, each too late by what delayed that packet, and the earliest estimate is the best one.
"""

from __future__ import annotations

import math

from lidario.revolution.ended import EndedRevolution

BITS_A_BYTE = 10
"""On a serial line with one start and one stop bit."""
DEVICE_DELAY_SAMPLES = 1.5


def first_sample_ns(ended: EndedRevolution, *, packet_bytes: float, byte_ns: float) -> int:
    """When the first sample was measured, by the least delayed packet.

    Args:
        ended: The revolution. Of its times, only `sample_ns` is read.
        packet_bytes: Mean length of a packet.
        byte_ns: Nanoseconds that a byte takes on the line.
    """
    revolution, packets, samples, sample_ns = ended.partial, ended.packets, ended.samples, ended.sample_ns
    carried = 0 if revolution.carried is None else len(revolution.carried)
    earliest = revolution.carried_ns - (carried - 1) * sample_ns if carried else math.inf
    ends, before = samples.ends, carried - 1
    if samples.certain and not samples.gaps and not revolution.lost_behind_carried:
        # Mostly. What follows would find the same.
        for count, at_ns in packets.arrivals:
            estimate = at_ns - (before + ends[count - 1]) * sample_ns
            if estimate < earliest:
                earliest = estimate
        return earliest_ns(earliest, sample_ns, packet_bytes * byte_ns)
    gaps = list(samples.gaps)
    if carried and revolution.lost_behind_carried:
        gaps.insert(0, (0, revolution.skipped_behind_carried))
    unbroken = -1 if gaps and not gaps[0][0] else samples.unbroken
    passed = 0
    for count, at_ns in packets.arrivals:
        end = ends[count - 1]
        if samples.certain:
            while passed < len(gaps) and gaps[passed][0] < end:
                before += gaps[passed][1]
                passed += 1
        elif count > unbroken and earliest < math.inf:
            # Behind a gap the number of samples since the beginning is not known.
            break
        earliest = min(at_ns - (before + end) * sample_ns, earliest)
    return earliest_ns(earliest, sample_ns, packet_bytes * byte_ns)


def earliest_ns(estimate: float, sample_ns: float, wire_ns: float) -> int:
    """The earliest of the estimates, without what delays every packet: the device and the line."""
    return round(estimate - DEVICE_DELAY_SAMPLES * sample_ns - wire_ns)


def byte_ns_at(baudrate: int) -> float:
    """Nanoseconds that a byte takes at so many bits a second; 0 for 0, where bytes take no time."""
    return BITS_A_BYTE * 1e9 / baudrate if baudrate else 0.0
