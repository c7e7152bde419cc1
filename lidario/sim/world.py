"""A world to scan: walls, a person who walks, and the scanner's noise.

`World.ranges_mm` is a pure function of angle and time: the same beam at the same moment gives the same
distance, noise included. Therefore a simulated device produces the same bytes whatever the steps in which
its time is advanced, and a test can ask the world what the device must have seen.

It has to serve thousands of revolutions per second, so walls, the walker's way and noise are tables that are
indexed while scanning.

Directions follow the devices: degrees clockwise seen from above, 0 forward. Coordinates are metres in the
scanner's frame, x forward and y to the left. A distance of 0 means no return.
"""

from collections.abc import Iterable
from typing import Protocol, TypeAlias, TypeGuard, runtime_checkable

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Segment = tuple[float, float, float, float]
"""A wall as (x1, y1, x2, y2) in metres."""
Wall: TypeAlias = tuple[tuple[float, float], tuple[float, float]]
"""From one point to another, (x, y) in metres."""

Pose: TypeAlias = tuple[float, float, float]
"""Where a scanner stands in a world: x and y in metres, and its forward axis in radians counter-clockwise."""

ORIGIN: Pose = (0.0, 0.0, 0.0)
DIRECTIONS = 1 << 15  # directions in the table of distances
_PER_DEGREE = DIRECTIONS / 360.0
_TICKS_PER_SECOND = 100
NOISES = 1 << 14
_FARTHEST_M = 1e6  # of a wall's end; the products of much larger coordinates overflow
_GIRTH_M = 0.25  # radius of the person who walks
_HASH = 2654435761  # 2**32 over the golden ratio (Knuth's multiplicative hash)


def cast(segments: Iterable[Segment]) -> Floats:
    """Cast a ray in every direction of the table against walls around the scanner.

    Returns millimetres to the nearest wall, float64 (32768,); 0 where there is none.
    """
    angles = np.radians((np.arange(DIRECTIONS) + 0.5) / _PER_DEGREE)
    dx, dy = np.cos(angles), -np.sin(angles)
    nearest = np.full(DIRECTIONS, np.inf)
    for x1, y1, x2, y2 in segments:
        np.minimum(nearest, to_wall(dx, dy, x1, y1, x2 - x1, y2 - y1), out=nearest)
    return np.where(np.isfinite(nearest), nearest * 1000.0, 0.0)


def to_wall(
    dx: Floats, dy: Floats, x: float | Floats, y: float | Floats, ex: float | Floats, ey: float | Floats
) -> Floats:
    """How far it is from the origin along the beams (dx, dy) to a wall; infinite where they miss it.

    The wall is the way (ex, ey) from its beginning at (x, y); metres, in arrays of shapes that fit together.
    """
    across = dx * ey - dy * ex
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (x * ey - y * ex) / across
        along = (x * dy - y * dx) / across
    hit = (distance > 0.0) & (along >= 0.0) & (along <= 1.0)
    return np.where(hit, distance, np.inf)


def seen_from(segments: Iterable[Segment], pose: Pose) -> list[Segment]:
    """Walls of a world in the frame of a scanner that stands there."""
    ends = np.asarray(list(segments), np.float64).reshape(-1, 2)
    return [(x1, y1, x2, y2) for x1, y1, x2, y2 in _within(ends, pose).reshape(-1, 4).tolist()]


def _within(points: Floats, pose: Pose) -> Floats:
    """Points of a world, shape (n, 2), in the frame of a scanner there."""
    x, y, yaw = pose
    turned = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    found: Floats = (points - np.array([x, y])) @ turned
    return found


def drawn(t: Floats, directions: npt.NDArray[np.int64] | int = 0) -> npt.NDArray[np.int64]:
    """Which number of a table of `NOISES` belongs to each time and direction."""
    draw = (t * 1e6).astype(np.int64)
    draw += directions << 20
    draw *= _HASH
    draw >>= 16
    draw &= NOISES - 1
    return draw


def hidden(ranges: Floats, off: Floats, distance: Floats, radius: float) -> Floats:
    """The ranges where a round body stands in the way: so far away, and so many radians `off` each beam.

    All of it in millimetres; a range of 0 is none. A scanner inside of a body sees nothing of it.
    """
    along, beside = distance * np.cos(off), distance * np.sin(off)
    inside = radius * radius - beside * beside
    near = along - np.sqrt(np.maximum(inside, 0.0))
    met = (inside > 0.0) & (along > 0.0) & (distance > radius) & ((ranges == 0.0) | (near < ranges))
    return np.where(met, near, ranges)


class Walker:
    """A person of circular outline who walks round an ellipse in `period_s`; the scanner must stay outside."""

    def __init__(
        self,
        centre: tuple[float, float],
        radii: tuple[float, float],
        *,
        period_s: float = 20.0,
        pose: Pose = ORIGIN,
    ) -> None:
        ticks = np.arange(round(period_s * _TICKS_PER_SECOND))
        phase = ticks * (2.0 * np.pi / len(ticks))
        way = np.stack((centre[0] + radii[0] * np.cos(phase), centre[1] + radii[1] * np.sin(phase)), axis=1)
        x, y = _within(way, pose).T
        distance = np.hypot(x, y)
        if float(distance.min()) <= _GIRTH_M:
            raise ValueError("a person walks there over the lidar: choose another pose")
        self._distance = distance * 1000.0
        self._bearing = np.degrees(np.arctan2(-y, x))

    def hide(self, ranges: Floats, angles: Floats, t: Floats) -> Floats:
        """The ranges of these beams (millimetres, degrees clockwise), shorter where they meet the person first."""
        ticks = (t * _TICKS_PER_SECOND).astype(np.int64)
        ticks %= len(self._distance)
        off = np.radians(angles - self._bearing[ticks])
        return hidden(ranges, off, self._distance[ticks], _GIRTH_M * 1000.0)


@runtime_checkable
class WorldLike(Protocol):
    """What a simulated scanner can measure: any object with this method, such as `World`."""

    def ranges_mm(
        self, angles_deg_clockwise: npt.NDArray[np.float64], t_seconds: npt.NDArray[np.float64], /
    ) -> npt.ArrayLike:
        """Measure along each direction at each time.

        It must depend on its arguments alone: a device measures some time ahead, in batches of any length.

        Args:
            angles_deg_clockwise: float64 (n,), degrees, any number of turns; 0 = forward (x), 90 = right (-y).
            t_seconds: float64 (n,), seconds on the clock of the simulation, not negative.

        Returns:
            (n,) numbers, millimetres, finite and not negative; 0 = no return.
        """
        ...


def measures(thing: object) -> TypeGuard[WorldLike]:
    """Whether an object is a world; also one that passes on what it is asked for (``__getattr__``).

    `isinstance` with `WorldLike` asks such an object in Python 3.11 only.
    """
    return hasattr(thing, "ranges_mm")


class World:
    """What a scanner at the origin sees: distances by direction as `cast` gives them, a person, and noise."""

    def __init__(
        self, static_mm: Floats, *, walker: Walker | None = None, noise_mm: float = 0.0, seed: int = 0
    ) -> None:
        self._static = static_mm
        self.walker = walker
        self._noise: Floats | None = None
        if noise_mm > 0.0:
            self._noise = np.random.default_rng(seed).normal(0.0, noise_mm, NOISES)

    def ranges_mm(self, angles_deg_clockwise: npt.ArrayLike, t_seconds: npt.ArrayLike) -> Floats:
        """As `WorldLike.ranges_mm`; also at one time for all beams. A copy."""
        angles = np.atleast_1d(np.asarray(angles_deg_clockwise, dtype=np.float64))
        directions = np.floor(angles * _PER_DEGREE).astype(np.int64)
        directions &= DIRECTIONS - 1
        ranges = self._static[directions]
        t = np.broadcast_to(np.asarray(t_seconds, dtype=np.float64), angles.shape)
        if self.walker is not None:
            ranges = self.walker.hide(ranges, angles, t)
        if self._noise is not None:
            noisy = ranges + self._noise[drawn(t, directions)]
            noisy *= ranges > 0.0
            ranges = np.maximum(noisy, 0.0, out=noisy)
        return ranges


class CheckedWorld:
    """A world of the user's own, with its results checked: a wrong one would only show as a broken stream.

    Its results are copied, so it may return the same array again and again. ValueError where it has no method
    `ranges_mm`.
    """

    def __init__(self, world: WorldLike) -> None:
        if isinstance(world, type) or not callable(getattr(world, "ranges_mm", None)):
            raise ValueError(f"a world needs a method ranges_mm(angles, times), and {_kind(world)} has none")
        self.world = world

    def ranges_mm(self, angles_deg_clockwise: Floats, t_seconds: Floats) -> Floats:
        """As `WorldLike.ranges_mm`; float64 (n,), a copy.

        Raises:
            ValueError: The world returned something else; an exception of the world itself passes unchanged.
        """
        found = self.world.ranges_mm(angles_deg_clockwise, t_seconds)
        returned = f"{_kind(self.world)}.ranges_mm returned"
        try:
            ranges: Floats = np.array(found, dtype=np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{returned} {_kind(found)} that is not an array of numbers") from error
        if ranges.shape != angles_deg_clockwise.shape:
            raise ValueError(f"{returned} shape {ranges.shape} for angles of shape {angles_deg_clockwise.shape}")
        wrong = ~(np.isfinite(ranges) & (ranges >= 0.0))
        if wrong.any():
            at = int(wrong.argmax())
            raise ValueError(
                f"{returned} {ranges[at]} mm at {angles_deg_clockwise[at] % 360.0:.1f} degrees; "
                "distances are finite and not negative, and 0 means no return"
            )
        return ranges


def as_world(world: WorldLike) -> World | CheckedWorld:
    """The world itself where it is ours, else with its results checked; raises as `CheckedWorld`."""
    return world if isinstance(world, World | CheckedWorld) else CheckedWorld(world)


def segments_of(walls: Iterable[Wall]) -> list[Segment]:
    """The walls that a user has given, as for `lidario.simulate`.

    Raises:
        ValueError: The walls are not numbers of that shape, or a number is not finite.
    """
    try:
        table = np.asarray(list(walls), dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"walls are ((x1, y1), (x2, y2)) in metres: {error}") from error
    if table.size and table.shape[1:] != (2, 2):
        raise ValueError(f"walls are ((x1, y1), (x2, y2)) in metres, an array (n, 2, 2) and not {table.shape}")
    if not (np.abs(table) <= _FARTHEST_M).all():
        raise ValueError(f"the ends of walls are finite numbers, at most {_FARTHEST_M:g} m away")
    return [(x1, y1, x2, y2) for x1, y1, x2, y2 in table.reshape(-1, 4).tolist()]


def _kind(thing: object) -> str:
    return f"the class {thing.__name__}" if isinstance(thing, type) else type(thing).__name__
