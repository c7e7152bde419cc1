"""Where a lidar has moved, from its scans alone; in a simulated room it drives: python odometry.py [SOURCE]."""

import sys
from collections import deque
from math import cos, pi, remainder, tau

import numpy as np
from numpy.typing import NDArray
from occupancy_grid import Grid

import lidario
from lidario import Mount, Velocity
from lidario.testing import Drive, SimulatedLidar, furnished

PARTS = [(1 - cos(pi * n / 90)) / 2 for n in range(91)]  # of the way: slow at first, slow at last
DRIVE = Drive([(1 + n / 10, 2 * part, part**2, part) for n, part in enumerate(PARTS)], furnished(), noise=0.005)


class Odometry:
    """Where the lidar is, seen from where it was first: a complex number of metres, and radians."""

    def __init__(self) -> None:
        self.place, self.yaw = 0j, 0.0
        self.at_ns, self._speed, self._turn = 0, 0j, 0.0  # in its own frame, a second
        self._seen: deque[NDArray[np.float64]] = deque(maxlen=5)  # a few, from places that are near

    def add(self, scan: lidario.Scan) -> NDArray[np.float64]:
        """Its points in the frame of the first one."""
        at_ns = scan.stamp_ns + scan.duration_ns
        seconds, self.at_ns = (at_ns - self.at_ns) * 1e-9, at_ns
        # It goes on as it did: so a revolution, which is bent, is made straight, and the search begins near by.
        xy = scan.points(motion=Velocity(self._speed.real, self._speed.imag, self._turn), at_ns=at_ns).xy
        xy = xy[:: 1 + len(xy) // 600]  # with more it is not better, and slower than a lidar
        if self._seen:
            ahead = self.place + self._speed * seconds * np.exp(1j * self.yaw)
            guess = Mount(ahead.real, ahead.imag, self.yaw + self._turn * seconds)
            found = lidario.register(np.concatenate(self._seen), xy, guess=guess).mount
            self._speed = (complex(found.x, found.y) - self.place) * np.exp(-1j * found.yaw) / seconds
            self._turn = remainder(found.yaw - self.yaw, tau) / seconds
            self.place, self.yaw = complex(found.x, found.y), found.yaw
        room = (xy[:, 0] + 1j * xy[:, 1]) * np.exp(1j * self.yaw) + self.place
        self._seen.append(np.stack((room.real, room.imag), axis=1))
        return self._seen[-1]


async def main(source: str = "", count: int = 110) -> list[tuple[float, float]]:
    """Print the grid, and how far off it was on the simulated drive; that is returned: metres and radians."""
    odometry, grid, off = Odometry(), Grid(), list[tuple[float, float]]()
    async with lidario.open_lidar(source or SimulatedLidar(world=DRIVE)) as lidar, lidar.scans() as scans:
        while len(off) < count and (scan := await anext(scans, None)) is not None:  # a recording may end before
            grid.see(odometry.add(scan), (odometry.place.real, odometry.place.imag))
            x, y, yaw = DRIVE.poses([odometry.at_ns])[0]
            off.append((abs(odometry.place - complex(x, y)), abs(remainder(odometry.yaw - yaw, tau))))
    print(f"{grid}\nat {odometry.place:.3f} m" + (f", off by {max(off)[0]:.3f} m at most" if not source else ""))
    return off


if __name__ == "__main__":
    lidario.run(main(sys.argv[1] if len(sys.argv) > 1 else ""))
