"""A revolution of which nothing is missing, and which took about as long as the one before: nearly all are so.

What `judge` and `count` find out of any revolution takes 8 us of Python, as much as all its headings. Here a few
comparisons show that they would find nothing unusual.
"""

from __future__ import annotations

from lidario.revolution.count import NOISE, Beginning
from lidario.revolution.ended import EndedRevolution
from lidario.revolution.judge import BROKEN_SHARE, FALSE_PART, UNEVEN, packet_time
from lidario.wire.formats import StreamFormat

__all__ = ["ordinary_beginning"]


def ordinary_beginning(
    wire: StreamFormat, ended: EndedRevolution, ordinary_ns: float, number: int, packets_before: int
) -> Beginning | None:
    """What `judge.beginning_of` tells, where `judge` has nothing else to tell; None where it may.

    Args:
        wire: The format.
        ended: The revolution, dated.
        ordinary_ns: What the revolution before took.
        number: As in `Beginning`.
        packets_before: As in `Beginning`.
    """
    partial, packets, samples = ended.partial, ended.packets, ended.samples
    if packets is None or samples is None or ended.lost or samples.lost:
        return None
    if not (partial.whole and samples.certain) or (partial.carried is None and partial.behind_gap):
        return None
    spanned_ns, elapsed_ns, turn_ns = (
        ended.spanned_ns,
        ended.elapsed_ns,
        samples.revolution_samples * ended.sample_ns,
    )
    if not FALSE_PART * turn_ns < spanned_ns < UNEVEN * turn_ns:
        return None
    # It may have come late, but not by much, nor as slowly as where every second packet is lost.
    late_ns = elapsed_ns - spanned_ns
    if late_ns > BROKEN_SHARE * ordinary_ns or elapsed_ns > UNEVEN * spanned_ns or late_ns < -NOISE * turn_ns:
        return None
    packet_ns, revolution_packets, ordinary = packet_time(wire, packets, samples, ended.sample_ns)
    return Beginning(
        ended.start_ns,
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
        spanned_ns=spanned_ns if ended.told else 0.0,
    )
