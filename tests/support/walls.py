"""A room that looks like no turned or mirrored one, and how far points are from its walls."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FRONT, BACK, LEFT, RIGHT = 3.0, -1.0, 2.0, -1.5
CORNERS = [(FRONT, RIGHT), (FRONT, LEFT), (BACK, LEFT), (BACK, RIGHT)]
WALLS = list(zip(CORNERS, [*CORNERS[1:], CORNERS[0]], strict=True))
"""Metres, x ahead of the lidar and y to its left."""
LONGEST_M = float(np.hypot(FRONT, LEFT))
"""To the corner that is farthest."""


def from_walls(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Metres from each point (n, 2) to the nearest wall."""
    distances = []
    for begin, end in np.array(WALLS):
        along = end - begin
        share = np.clip((points - begin) @ along / (along @ along), 0.0, 1.0)
        distances.append(np.linalg.norm(points - (begin + share[:, None] * along), axis=1))
    nearest: NDArray[np.float64] = np.min(distances, axis=0)
    return nearest


def is_at_ten_hertz(stamps_ns: Sequence[int]) -> bool:
    """Whether revolutions are a tenth of a second apart; on a busy machine some between them may be missing."""
    turns = np.diff(stamps_ns) / 1e8
    return bool(turns.min() > 0.9 and np.abs(turns - np.round(turns)).max() < 0.1)


def is_all_around(points: NDArray[np.floating]) -> bool:
    """Whether there are points at every wall, to within a decimetre of its ends."""
    low, high = points.min(axis=0), points.max(axis=0)
    return bool(np.allclose([low, high], [(BACK, RIGHT), (FRONT, LEFT)], atol=0.1))
