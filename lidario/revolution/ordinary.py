"""A revolution of which nothing is missing, and which took about as long as the one before: nearly all are so.

What `judge` and `count` find out of any revolution takes 8 us of Python, as much as all its headings. Here a few
comparisons show that they would find nothing unusual.
"""

from __future__ import annotations

from lidario.families.base import Samples
from lidario.revolution.count import NOISE, Beginning
from lidario.revolution.judge import BROKEN_SHARE, FALSE_PART, UNEVEN
from lidario.revolution.partial import PartialRevolution

__all__ = ["ordinary_beginning"]


def ordinary_beginning(
    ended: PartialRevolution,
    packets: int,
    samples: Samples,
    *,
    start_ns: int,
    elapsed_ns: int,
    spanned_ns: float,
    ordinary_ns: float,
    sample_ns: float,
) -> Beginning | None:
    """What `judge.beginning_of` tells, where `judge` has nothing else to tell; None where it may.

    Args:
        ended: The revolution.
        packets: How many came of it.
        samples: What they were decoded to.
        start_ns: When its first sample was measured.
        elapsed_ns: Time from then to the arrival of its last packet.
        spanned_ns: Time that its samples take.
        ordinary_ns: What the revolution before took.
        sample_ns: Nanoseconds a sample.
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
    each_ns = turn_ns / samples.revolution_packets
    return Beginning(start_ns, 0.0, turn_ns, samples.revolution_packets, each_ns, packets, 0, broken=False)
