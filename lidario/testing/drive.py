"""A lidar that drives through a room: what it sees from each place of its way, and where it truly was."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidario import Wall
from lidario.basics.arguments import finite, whole
from lidario.sim.rooms import furnished_room
from lidario.sim.world import NOISES, Floats, drawn, to_wall
from lidario.testing.surroundings import segments, table_of


def furnished() -> list[Wall]:
    """The walls and the furniture of the world ``room``: eight metres by six, seen from its origin by ``sim://``."""
    return [((x1, y1), (x2, y2)) for x1, y1, x2, y2 in furnished_room()]


class Drive:
    """What a lidar sees that drives through a room; a `lidario.WorldLike`, so give it to `SimulatedLidar(world=)`.

    ::

        drive = Drive([(0, 0.0, 0.0, 0.0), (10, 2.0, 0.0, 1.57)], furnished())
        async with lidario.open_lidar(SimulatedLidar(world=drive)) as lidar:
            scan = await lidar.scan()
            x, y, yaw = drive.poses([scan.stamp_ns])[0]

    Each sample is measured from where the lidar was at its own time, so a revolution is bent as a real one is.

    Args:
        path: Where the lidar is: seconds, metres, metres, and radians counter-clockwise that may go on above pi. In
            between it moves straight and turns evenly; before the first and after the last it stands. Seconds count
            from the first measurement.
        walls: Each ``((x1, y1), (x2, y2))`` in metres, in the frame of the room.
        noise: Standard deviation of the ranges, metres.
        seed: Decides the noise.

    Raises:
        InvalidValue: The path is empty or goes back in time, a number is not finite, or the walls cannot be right.
    """

    def __init__(
        self,
        path: Sequence[tuple[float, float, float, float]],
        walls: Iterable[Wall],
        *,
        noise: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._path = table_of(path, 4, "a drive is [(seconds, x, y, yaw), ...]")
        self._walls = np.array(segments(walls)).reshape(-1, 4)
        noise_mm = finite(noise, "the noise of the ranges") * 1000.0
        self._noise: Floats = np.random.default_rng(whole(seed, "a seed")).normal(0.0, abs(noise_mm), NOISES)
        self._begun_s: float | None = None

    def poses(self, times_ns: ArrayLike) -> NDArray[np.float64]:
        """Where the lidar was: a function of times, as `lidario.PoseFunction`.

        Args:
            times_ns: On the clock of `Scan.stamp_ns`, shape (n,).

        Returns:
            Metres, metres, radians counter-clockwise, in the frame of the room; shape (n, 3).
        """
        return self._at(np.asarray(times_ns, np.float64) * 1e-9)

    def ranges_mm(self, angles_deg_clockwise: Floats, t_seconds: Floats, /) -> Floats:
        """Distances in millimetres at those angles and times; float64, 0 where nothing is hit."""
        angles = np.atleast_1d(np.asarray(angles_deg_clockwise, np.float64))
        seconds = np.broadcast_to(np.asarray(t_seconds, np.float64), angles.shape)
        if not len(angles):
            return np.zeros(0)
        # At the time 0 a world is only tried; no clock of an event loop is there.
        if self._begun_s is None and seconds[0] > 0.0:
            self._begun_s = float(seconds[0])
        poses = self._at(seconds)
        toward = poses[:, 2] - np.radians(angles)
        # Along each beam to each wall: shape (n, walls).
        dx, dy = np.cos(toward)[:, None], np.sin(toward)[:, None]
        x1, y1 = self._walls[:, 0] - poses[:, :1], self._walls[:, 1] - poses[:, 1:2]
        ex, ey = self._walls[:, 2] - self._walls[:, 0], self._walls[:, 3] - self._walls[:, 1]
        nearest = to_wall(dx, dy, x1, y1, ex, ey).min(axis=1, initial=np.inf)
        measured: Floats = np.where(
            np.isfinite(nearest), np.maximum(nearest * 1000.0 + self._noise[drawn(seconds)], 0.0), 0.0
        )
        return measured

    def _at(self, seconds: Floats) -> NDArray[np.float64]:
        when, since = self._path[:, 0], np.atleast_1d(seconds) - (self._begun_s or 0.0)
        return np.stack([np.interp(since, when, each) for each in self._path[:, 1:].T], axis=1)
