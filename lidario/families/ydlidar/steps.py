"""The angle from one sample of a packet to the next: of a revolution, or of each packet where it changes.

A packet states the angles of its first and its last sample; its *way* lies between.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["CHANGING", "FEWEST", "STEADY", "Ints", "Steps", "changing_steps", "mean_step"]

Ints = NDArray[np.int32]
Steps = NDArray[np.float64]

STEADY: Final = 2.0
"""Times the mean step that the step of one packet may be, where those beside it do not come near it."""
CHANGING: Final = 1.1
"""If the longest way exceeds that of the mean step by this factor, a change of speed is looked for."""
_ALIKE: Final = 0.2
"""Greatest relative difference between the steps of consecutive packets while the speed changes; more is damage."""
_SEVERAL: Final = 8
"""Samples of a packet from which its step is known well enough for that."""
FEWEST: Final = 6
"""Packets from which the longest one is taken for an ordinary one. A revolution has two short ones: the start
packet and the last one."""


def mean_step(way: Ints, counts: Ints, most: int, farthest: int, samples: int) -> float:
    """The angle from one sample to the next; 0 when no packet has two of them."""
    steps = samples - len(counts)
    if not steps:
        return 0.0
    mean = int(np.add.reduce(way)) / steps
    if farthest <= STEADY * mean * (most - 1):
        return mean
    # A damaged angle that the check value let pass; the others tell the truth.
    several = counts > 1
    return float(np.median(way[several] / (counts[several] - 1)))


def changing_steps(way: Ints, counts: Ints) -> Steps | None:
    """The step of each packet, shape (packets,), where steps change little from packet to packet.

    None where one differs much, or where too few packets have several samples.
    """
    long = (counts >= _SEVERAL).nonzero()[0]
    if len(long) < FEWEST:
        return None
    own = way[long] / (counts[long] - 1)
    least = np.minimum(own[1:], own[:-1])
    if not least.min() > 0 or not (np.abs(own[1:] - own[:-1]) <= _ALIKE * least).all():
        return None
    # A short one has that of the long one before.
    steps: Steps = own[np.maximum(np.searchsorted(long, np.arange(len(way)), "right") - 1, 0)]
    return steps
