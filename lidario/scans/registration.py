"""How one cloud of points lies on another one: where a second lidar is mounted, how far a robot has moved.

The work is done by ``small_gicp``, a library for clouds in space. Points of a plane have no surface there, and it
would find none: so each cloud is raised to a low fence, several copies one above the other, and the walls are
surfaces again. A fence as high below as above keeps the result in the plane.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import shown
from lidario.basics.words import counted
from lidario.errors import InvalidValue, Unsupported
from lidario.scans.points import Mount, in_frame

_Floats = NDArray[np.float64]

LEAST_POINTS: Final = 30
FENCE_M: Final = (-0.1, -0.05, 0.0, 0.05, 0.1)
NEIGHBORS: Final = 20
"""Of which a surface is made: those beside a point on its own level and on the next ones."""
COARSE_M: Final = 0.1
FINE_M: Final = 0.02
"""One point is kept for each cube of this size."""
HEADINGS: Final = 24
FAR_M: Final = 1.5
"""How far apart two clouds may be before they are turned rightly: lidars of one robot are no farther."""
NEAR_M: Final = 0.1  # points farther than this from the other cloud belong to what only one of the two sees
RIVAL_TURN: Final = math.radians(5.0)
BESIDE_M: Final = 0.1
BESIDE_DIRECTIONS: Final = 24
BESIDE_TURN: Final = math.radians(6.0)
BACK_TURN: Final = math.radians(1.0)
"""From `BESIDE_TURN` beside it the search comes back as near as this, where the room holds the direction."""


@dataclass(frozen=True, slots=True)
class Registration:
    """Where the frame of one cloud is in the frame of another.

    Attributes:
        mount: Origin and forward axis of the second frame in the first.
        residual: Metres between points that both see: the median.
        share: Part of the second cloud that is within 0.1 m of the first, 0 to 1.
        rival: The same part for the best other direction that was tried; near to `share`, the room looks alike
            from several sides, and nothing tells which is right. 0 where a guess was given.
    """

    mount: Mount
    residual: float
    share: float
    rival: float


def register(
    first: NDArray[np.floating], second: NDArray[np.floating], *, guess: Mount | None = None
) -> Registration:
    """Find where the frame of the second cloud is in the frame of the first, from points of the same room.

    Args:
        first: Metres, shape (n, 2), as `Points.xy`.
        second: Likewise, of the other lidar, or of the same one later.
        guess: About where it is, within 0.5 m and 20 degrees; None to try all directions, as for two lidars that
            are less than 1.5 m apart.

    Raises:
        InvalidValue: One of them is no such array, or has less than 30 points.
        Unsupported: ``small_gicp`` is not installed.
    """
    try:
        import small_gicp
    except ModuleNotFoundError:
        raise Unsupported("laying clouds on each other needs small_gicp: pip install small_gicp") from None
    fixed, moving = _checked(first, "first"), _checked(second, "second")
    if guess is not None and not isinstance(guess, Mount):
        raise InvalidValue(f"guess is a Mount, not {shown(guess)}")
    coarse = _Cloud(small_gicp, fixed, COARSE_M), _Cloud(small_gicp, moving, COARSE_M)
    fine = _Cloud(small_gicp, fixed, FINE_M), _Cloud(small_gicp, moving, FINE_M)
    turns = [Mount(0.0, 0.0, math.tau * each / HEADINGS) for each in range(HEADINGS)]
    seen, (few, stand_for) = _Seen(small_gicp, fixed), _thinned(moving)
    found = []
    for begin in [guess] if guess is not None else turns:
        rough = _aligned(small_gicp, coarse, begin, FAR_M if guess is None else 0.5)
        rough = _aligned(small_gicp, coarse, rough, 0.3)
        found.append((seen.share(few, stand_for, rough, NEAR_M), rough))
    mount = _aligned(small_gicp, fine, max(found, key=lambda each: each[0])[1], NEAR_M)
    apart = seen.distances(moving, mount)
    shared = apart[apart < NEAR_M]
    others = [share for share, each in found if abs(math.remainder(each.yaw - mount.yaw, math.tau)) > RIVAL_TURN]
    return Registration(
        mount,
        float(np.median(shared)) if len(shared) else math.inf,
        len(shared) / len(apart),
        max(others, default=0.0),
    )


def looseness(first: NDArray[np.floating], second: NDArray[np.floating], found: Registration) -> float:
    """How well a place beside the found one explains the same points: near 1, nothing holds it where it is.

    Along a corridor, beside one wall, or around the middle of a round room all places fit alike, `register` returns
    any, and its residual is small. So the second cloud is shifted by 0.1 m in every direction, and is laid on the
    first once more from 6 degrees beside.

    Args:
        first: As for `register`.
        second: As there.
        found: What `register` has found for them.

    Returns:
        The greatest part of the points that lie on the first cloud, and do so there too. Below 0.8 in rooms with
        walls in several directions.

    Raises:
        InvalidValue: As `register`, or `found` is no `Registration`.
        Unsupported: As there.
    """
    if not isinstance(found, Registration):
        raise InvalidValue(f"found is what register() returns, not {shown(found)}")
    mount, beside = found.mount, []
    for turn in (BESIDE_TURN, -BESIDE_TURN):
        other = register(first, second, guess=Mount(mount.x, mount.y, mount.yaw + turn))
        is_back = abs(math.remainder(other.mount.yaw - mount.yaw, math.tau)) < BACK_TURN
        beside.append(0.0 if is_back or not found.share else other.share / found.share)
    import small_gicp

    seen, (few, stand_for) = _Seen(small_gicp, _checked(first, "first")), _thinned(_checked(second, "second"))
    near = max(FINE_M, 3 * found.residual)
    here = seen.share(few, stand_for, mount, near)
    for direction in np.arange(BESIDE_DIRECTIONS) * (math.tau / BESIDE_DIRECTIONS):
        shifted = Mount(
            mount.x + BESIDE_M * math.cos(direction), mount.y + BESIDE_M * math.sin(direction), mount.yaw
        )
        there = seen.share(few, stand_for, shifted, near)
        beside.append(there / here if here else 1.0)
    return max(beside)


class _Cloud:
    """A cloud as the library takes it: raised to a fence, thinned, with its surfaces."""

    def __init__(self, library: Any, xy: _Floats, size: float) -> None:
        levels = np.repeat(FENCE_M, len(xy))
        points = np.column_stack((np.tile(xy, (len(FENCE_M), 1)), levels))
        self.points, self.tree = library.preprocess_points(points, size, NEIGHBORS)


def _aligned(library: Any, clouds: tuple[_Cloud, _Cloud], begin: Mount, far_m: float) -> Mount:
    first, second = clouds
    cos, sin = math.cos(begin.yaw), math.sin(begin.yaw)
    pose = np.eye(4)
    pose[:2] = [[cos, -sin, 0.0, begin.x], [sin, cos, 0.0, begin.y]]
    found = library.align(
        first.points, second.points, first.tree, init_T_target_source=pose,
        registration_type="PLANE_ICP", max_correspondence_distance=far_m, max_iterations=60,
        rotation_epsilon=1e-5, translation_epsilon=1e-5,
    ).T_target_source  # fmt: skip
    return Mount(float(found[0, 3]), float(found[1, 3]), math.atan2(found[1, 0], found[0, 0]))


def _thinned(xy: _Floats) -> tuple[_Floats, _Floats]:
    """One point for each square of `FINE_M`, and how many it stands for.

    Scans of a lidar that stands still show the same walls again and again: 20 scans have 20 times as many points as
    one of them, and hardly more squares.
    """
    _, first, counts = np.unique(np.floor(xy / FINE_M), axis=0, return_index=True, return_counts=True)
    return xy[first], counts.astype(np.float64)


class _Seen:
    """A cloud that another one is laid on."""

    def __init__(self, library: Any, xy: _Floats) -> None:
        self._tree = library.KdTree(np.column_stack((xy, np.zeros(len(xy)))))

    def distances(self, moving: _Floats, mount: Mount) -> _Floats:
        """From each point of another cloud, whose frame is there, to the nearest one of this, metres."""
        placed = in_frame(moving, mount)
        _, squares = self._tree.batch_nearest_neighbor_search(np.column_stack((placed, np.zeros(len(placed)))))
        distances: _Floats = np.sqrt(np.asarray(squares, np.float64))
        return distances

    def share(self, few: _Floats, stand_for: _Floats, mount: Mount, near: float) -> float:
        """The part of a thinned cloud, whose frame is there, that is so near to this one, 0 to 1."""
        return float(np.average(self.distances(few, mount) < near, weights=stand_for))


def _checked(cloud: NDArray[np.floating], what: str) -> _Floats:
    try:
        found = np.asarray(cloud, np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.ndim != 2 or found.shape[1:] != (2,) or not np.isfinite(found).all():
        raise InvalidValue(f"the {what} cloud is finite metres of shape (n, 2), as scan.points().xy")
    if len(found) < LEAST_POINTS:
        raise InvalidValue(f"the {what} cloud has {counted(len(found), 'point')}, and {LEAST_POINTS} are needed")
    return found
