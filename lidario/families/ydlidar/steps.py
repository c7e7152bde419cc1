"""The angle from one sample of a packet to the next: of a revolution, or of each packet where it changes.

A packet states the angles of its first and its last sample; its *way* lies between.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["CHANGING", "FEWEST", "STEADY", "Ints", "changing_steps", "mean_step"]

Ints = NDArray[np.int32]

STEADY: Final = 2.0
"""Times the mean step that the step of one packet may be, where those beside it do not come near it."""
CHANGING: Final = 1.1
"""Times the mean step from which it is worth seeing whether the rotor changes its speed."""
_ALIKE: Final = 0.2
"""Part by which the steps of two packets in a row differ while it does; more is damage."""
_SEVERAL: Final = 8
"""Samples of a packet from which its step is known well enough for that."""
FEWEST: Final = 6
"""Packets of which the longest is surely an ordinary one: the only short ones of a revolution are its last two."""


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


def changing_steps(way: Ints, counts: Ints) -> NDArray[np.float64] | None:
    """The step of each packet where the rotor changes its speed, shape (packets,); None where it does not."""
    long = (counts >= _SEVERAL).nonzero()[0]
    if len(long) < FEWEST:
        return None
    own = way[long] / (counts[long] - 1)
    least = np.minimum(own[1:], own[:-1])
    if not least.min() > 0 or not (np.abs(own[1:] - own[:-1]) <= _ALIKE * least).all():
        return None
    # A short one has that of the long one before.
    steps: NDArray[np.float64] = own[np.maximum(np.searchsorted(long, np.arange(len(way)), "right") - 1, 0)]
    return steps
