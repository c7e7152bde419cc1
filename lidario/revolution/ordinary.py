"""A revolution of which nothing is missing, and which took about as long as the one before: nearly all are so.

What `judge` and `count` find out of any revolution takes 8 us of Python, as much as all its headings. Here a few
comparisons show that they would find nothing unusual.
"""

from __future__ import annotations

from lidario.families.base import Samples
from lidario.revolution.count import NOISE, Beginning
from lidario.revolution.judge import BROKEN_SHARE, FALSE_PART, UNEVEN, packet_time
from lidario.revolution.partial import PartialRevolution
from lidario.wire.events import Packets
from lidario.wire.formats import StreamFormat

__all__ = ["ordinary_beginning"]


def ordinary_beginning(
    wire: StreamFormat,
    ended: PartialRevolution,
    packets: Packets,
    samples: Samples,
    *,
    start_ns: int,
    elapsed_ns: int,
    spanned_ns: float,
    ordinary_ns: float,
    sample_ns: float,
    number: int,
    packets_before: int,
) -> Beginning | None:
    """What `judge.beginning_of` tells, where `judge` has nothing else to tell; None where it may.

    Args:
        wire: The format.
        ended: The revolution.
        packets: Its packets.
        samples: What they were decoded to.
        start_ns: When its first sample was measured.
        elapsed_ns: Time from then to the arrival of its last packet.
        spanned_ns: Time that its samples take.
        ordinary_ns: What the revolution before took.
        sample_ns: Nanoseconds a sample.
        number: As in `Beginning`.
        packets_before: As in `Beginning`.
    """
    if not (ended.whole and samples.certain) or samples.lost or (ended.carried is None and ended.behind_gap):
        return None
    turn_ns = samples.revolution_samples * sample_ns
    if not FALSE_PART * turn_ns < spanned_ns < UNEVEN * turn_ns:
        return None
    # It may have come late, but not by much, nor as slowly as where every second packet is lost.
    late_ns = elapsed_ns - spanned_ns
    if late_ns > BROKEN_SHARE * ordinary_ns or elapsed_ns > UNEVEN * spanned_ns or late_ns < -NOISE * turn_ns:
        return None
    packet_ns, revolution_packets, ordinary = packet_time(wire, packets, samples, sample_ns)
    return Beginning(
        start_ns,
        0.0,
        turn_ns,
        revolution_packets,
        packet_ns,
        packets.count,
        0,
        broken=False,
        number=number,
        packets_before=packets_before,
        ordinary=ordinary,
    )
