"""Where a lidar has moved, from its scans alone: each is laid on those before it. And the grid of what it has seen.

python odometry.py [SOURCE]
"""

import math
import sys
from cmath import exp
from collections import deque

import numpy as np
from numpy.typing import NDArray
from occupancy_grid import Grid

import lidario
from lidario import Mount, Velocity

MOST = 600  # points of a scan: with more it is not better, and slower than a lidar
KEPT = 5  # scans that the next one is laid on: a few, from places that are near


class Odometry:
    """Where the lidar is, seen from where it was first: a complex number of metres, and radians."""

    def __init__(self) -> None:
        self.place, self.yaw = 0j, 0.0
        self._speed, self._turn, self._last_ns = 0j, 0.0, 0  # in its own frame, a second
        self._seen: deque[NDArray[np.float64]] = deque(maxlen=KEPT)

    def add(self, scan: lidario.Scan) -> NDArray[np.float64]:
        """Its points in the frame of the first one."""
        at_ns = scan.stamp_ns + scan.duration_ns
        seconds, self._last_ns = (at_ns - self._last_ns) * 1e-9, at_ns
        # It goes on as it did: so a revolution, which is bent, is made straight, and the search begins near by.
        xy = scan.points(motion=Velocity(self._speed.real, self._speed.imag, self._turn), at_ns=at_ns).xy
        xy = xy[:: 1 + len(xy) // MOST]
        if self._seen:
            ahead = self.place + self._speed * seconds * exp(1j * self.yaw)
            guess = Mount(ahead.real, ahead.imag, self.yaw + self._turn * seconds)
            found = lidario.register(np.concatenate(self._seen), xy, guess=guess).mount
            self._speed = (complex(found.x, found.y) - self.place) * exp(-1j * found.yaw) / seconds
            self._turn = math.remainder(found.yaw - self.yaw, math.tau) / seconds
            self.place, self.yaw = complex(found.x, found.y), found.yaw
        room = (xy[:, 0] + 1j * xy[:, 1]) * exp(1j * self.yaw) + self.place
        self._seen.append(np.stack((room.real, room.imag), axis=1))
        return self._seen[-1]


async def main(
    source: str | lidario.SimulatedDevice = "auto", count: int = 100
) -> list[tuple[int, complex, float]]:
    """Print where it is in the end, and the grid; returns the times, places and directions on the way."""
    odometry, grid = Odometry(), Grid()
    way: list[tuple[int, complex, float]] = []
    async with lidario.open_lidar(source) as lidar, lidar.scans() as scans:
        while len(way) < count:
            scan = await anext(scans)
            grid.see(odometry.add(scan), (odometry.place.real, odometry.place.imag))
            way.append((scan.stamp_ns + scan.duration_ns, odometry.place, odometry.yaw))
    print(f"{grid}\nx = {odometry.place.real:.3f} m, y = {odometry.place.imag:.3f} m")
    return way


if __name__ == "__main__":
    lidario.run(main(sys.argv[1] if len(sys.argv) > 1 else "auto"))
