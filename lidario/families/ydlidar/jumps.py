"""How far each packet begins behind the end of the one before, and the angles that are wrong there.

Within one packet the angle advances by one step a sample, and so it does from one packet to the next. What a *jump*
holds beyond that was lost, or one of the two angles beside it is damaged, although the check value of its packet is
right. Then the way from the first to the last sample of that packet is not what the step of the revolution tells.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lidario.families.ydlidar.formats import FULL_TURN_Q6
from lidario.families.ydlidar.steps import STEADY, Ints, Steps

__all__ = ["ONE_STEP", "SLACK_SAMPLES", "heading_of", "jumps_between", "mended"]

ONE_STEP: Final = 1.5
"""Steps: nothing is missing in a jump of one; half a step more is the least that can mean something."""
SLACK_SAMPLES: Final = 3.0
"""Missing samples below which a jump is taken for unsteadiness of the rotor, where no start packet is due."""
_BACKWARD_Q6: Final = 2 << 6
"""How far a packet may begin before the end of the one before, without a revolution being missing."""


def heading_of(packet: bytes) -> int:
    """The angle of the first sample of a packet, 1/64 degrees."""
    return (packet[4] >> 1 | packet[5] << 7) % FULL_TURN_Q6


def jumps_between(first: Ints, tails: Ints, following: bytes | None) -> Ints:
    """How far ahead of the end of each packet the next one begins; 0 where it begins a little before that.

    Args:
        first: Angles of the first samples, 1/64 degrees, shape (packets,), as all arrays here.
        tails: Angles of the last samples, counted on past 360 degrees.
        following: The packet behind them; None where it is not known, and its jump then 0.
    """
    jumps = np.empty_like(first)
    np.subtract(first[1:], tails[:-1], out=jumps[:-1])
    jumps[-1] = 0 if following is None else heading_of(following) - tails[-1]
    jumps %= FULL_TURN_Q6
    jumps[jumps > FULL_TURN_Q6 - _BACKWARD_Q6] = 0
    return jumps


def mended(
    first: Ints,
    tails: Ints,
    jumps: Ints,
    following: bytes | None,
    counts: Ints,
    step: Steps | float,
) -> tuple[Ints, Ints] | None:
    """Angles of first and last samples; one that is damaged is computed from the other one of its packet.

    An angle is taken as damaged if it is farther from the other one than any speed explains, or if its packet has
    an unusual way and the jump beside it disappears when the angle is computed.

    Args:
        first: As for `jumps_between`.
        tails: Likewise.
        jumps: What that found of them.
        following: As for `jumps_between`.
        counts: Samples of each packet.
        step: The angle from one sample to the next, of each packet or of them all.

    Returns:
        None where no angle is damaged.
    """
    usual: Steps = np.multiply(counts - 1, step, dtype=np.float64)
    off = tails - first - usual
    too_far = off > (STEADY - 1) * usual + step
    odd = too_far | (np.abs(off) > SLACK_SAMPLES * step)
    if not odd.any():
        return None
    ways, one_step = np.rint(usual).astype(np.int32), ONE_STEP * step
    ahead = jumps > one_step
    # The first angle is damaged if the next packet begins right behind the last angle,
    wrong_first = too_far & ~ahead
    if following is None:
        wrong_first[-1] = False
    # or if the packet before ends right before the first angle, once that is computed.
    from_last = (tails - ways) % FULL_TURN_Q6
    near = jumps_between(from_last, tails, following) <= one_step
    wrong_first[1:] |= odd[1:] & ahead[:-1] & near[:-1]
    near = jumps_between(first, first + ways, following) <= one_step
    wrong_last = ~wrong_first & ahead & (too_far | odd & near)
    if not (wrong_first | wrong_last).any():
        return None
    begins = np.where(wrong_first, from_last, first)
    ends = np.where(wrong_first, from_last + ways, np.where(wrong_last, first + ways, tails))
    return begins, ends
