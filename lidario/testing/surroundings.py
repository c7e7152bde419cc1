"""What a simulated lidar of a test sees: walls that stand still, and bodies that move."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidario import InvalidValue, Wall
from lidario.basics.arguments import MODERATE, finite, moderate, shown, whole
from lidario.sim.world import Floats, Segment, World, cast, hidden, segments_of


@dataclass(frozen=True, slots=True)
class Body:
    """Something round that stands or moves: a person, a leg, a pillar, another robot.

    ::

        Body([(0, 1.5, 0.0)])                        # stands 1.5 m ahead
        Body([(0, 3.0, 0.0), (2, 0.4, 0.0)])         # comes from 3 m to 0.4 m in two seconds, and stays
        Body([(0, 2.0, 2.0), (4, 2.0, -2.0)], 0.1)   # crosses from left to right, 0.2 m thick

    Attributes:
        path: Where its middle is: seconds, metres forward, metres to the left. In between it moves straight and
            steadily; before the first and after the last it stands. Seconds count from the moment at which the
            lidar is first opened, or from `SimulatedLidar.show`.
        radius: Metres.

    Raises:
        InvalidValue: The path is empty or goes back in time, a number is not finite, or the radius is not positive.
    """

    path: Sequence[tuple[float, float, float]]
    radius: float = 0.25

    def __post_init__(self) -> None:
        table_of(self.path, 3, "the path of a body is [(seconds, x, y), ...]")
        object.__setattr__(self, "radius", moderate(self.radius, "the radius of a body"))
        if self.radius <= 0.0:
            raise InvalidValue(f"the radius of a body is a positive number of metres, not {self.radius}")

    def at(self, seconds: float) -> tuple[float, float]:
        """Where its middle is at a time: metres forward, metres to the left."""
        when, x, y = np.asarray(self.path, np.float64).T
        return float(np.interp(seconds, when, x)), float(np.interp(seconds, when, y))

    def hide(self, ranges: Floats, angles: Floats, seconds: Floats) -> None:
        """Shorten, in place, the beams (millimetres, degrees clockwise) that meet it before anything else."""
        when, xs, ys = np.asarray(self.path, np.float64).T
        x, y = np.interp(seconds, when, xs), np.interp(seconds, when, ys)
        off = np.radians(angles) + np.arctan2(y, x)  # clockwise angles: the bearing has the other sign
        ranges[:] = hidden(ranges, off, 1000.0 * np.hypot(x, y), 1000.0 * self.radius)


def room(width: float = 4.0, depth: float = 4.0) -> list[Wall]:
    """Four walls around the lidar, which stands in the middle and faces a wall.

    Args:
        width: Metres from the left wall to the right one.
        depth: Metres from the wall ahead to the one behind.

    Raises:
        InvalidValue: One of them is no finite number.
    """
    x, y = finite(depth, "the depth of a room") / 2, finite(width, "the width of a room") / 2
    corners = [(x, y), (-x, y), (-x, -y), (x, -y), (x, y)]
    return list(pairwise(corners))


class Surroundings(World):
    """Walls and bodies, which may be replaced while a lidar looks at them; as for `SimulatedLidar`."""

    def __init__(self, walls: Iterable[Wall], bodies: Iterable[Body], noise: float, seed: int) -> None:
        noise_mm = finite(noise, "the noise of the ranges") * 1000.0
        super().__init__(cast(segments(walls)), noise_mm=noise_mm, seed=whole(seed, "a seed"))
        self.bodies: tuple[Body, ...] = _bodies(bodies)
        self._begun_s: float | None = None

    def begin(self, now: int) -> None:
        """The time of the bodies begins at `now`, nanoseconds; later calls change nothing."""
        if self._begun_s is None:
            self._begun_s = now * 1e-9

    def show(self, walls: Iterable[Wall] | None, bodies: Iterable[Body] | None) -> None:
        """Replace what is given. The time of new bodies begins at the next `begin`."""
        if walls is not None:
            self._static = cast(segments(walls))
        if bodies is not None:
            self.bodies, self._begun_s = _bodies(bodies), None

    def ranges_mm(self, angles_deg_clockwise: ArrayLike, t_seconds: ArrayLike) -> Floats:
        """As `World.ranges_mm`, with the bodies in front of the walls."""
        ranges = super().ranges_mm(angles_deg_clockwise, t_seconds)
        if self.bodies:
            angles = np.atleast_1d(np.asarray(angles_deg_clockwise, np.float64))
            begun = self._begun_s or 0.0
            seconds: NDArray[np.float64] = np.broadcast_to(np.asarray(t_seconds, np.float64) - begun, angles.shape)
            for body in self.bodies:
                body.hide(ranges, angles, seconds)
        return ranges


def _bodies(bodies: Iterable[Body]) -> tuple[Body, ...]:
    try:
        found = tuple(bodies)
        right = all(isinstance(body, Body) for body in found)
    except TypeError:
        found, right = (), False
    if not right:
        raise InvalidValue(f"bodies are a list of Body(...), not {shown(bodies)}")
    return found


def segments(walls: Iterable[Wall]) -> list[Segment]:
    """The walls that a test has given. Raises InvalidValue where they cannot be right."""
    try:
        return segments_of(walls)
    except ValueError as error:
        raise InvalidValue(str(error)) from None


def table_of(path: object, columns: int, what: str) -> Floats:
    """A path as an array, shape (n, columns), the times in the first one; InvalidValue where it cannot be right."""
    table: Floats
    try:
        table = np.asarray(path, np.float64)
    except (TypeError, ValueError, OverflowError):
        table = np.zeros(0)
    if table.ndim != 2 or table.shape[1] != columns or not len(table) or not (np.abs(table) <= MODERATE).all():
        raise InvalidValue(f"{what}, finite numbers, at least one of them, not {shown(path)}")
    if (np.diff(table[:, 0]) < 0).any():
        raise InvalidValue(f"{what}, goes forward in time, and this one goes back: {shown(path)}")
    return table
