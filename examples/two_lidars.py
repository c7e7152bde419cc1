"""The points of two lidars in the frame of one robot, each where the robot would have seen it at one instant.

python two_lidars.py FRONT REAR
"""

import asyncio
import math
import sys

import numpy as np

import lidario
from lidario import Mount, Points, Scan, Velocity

FRONT = Mount(x=0.20)
REAR = Mount(x=-0.20, yaw=math.pi)
TOO_OLD_S = 0.25  # a scan that has waited for the other one shows where the robot was


def together(front: Scan, rear: Scan, motion: Velocity) -> Points:
    """Both scans in the robot's frame, at the end of the later one."""
    at_ns = max(scan.stamp_ns + scan.duration_ns for scan in (front, rear))
    return lidario.merge(
        front.points(FRONT, motion=motion, at_ns=at_ns),
        rear.points(REAR, motion=motion, at_ns=at_ns),
    )


async def main(front: str | lidario.SimulatedDevice, rear: str | lidario.SimulatedDevice, count: int = 3) -> Points:
    """Print what each merge holds, and return the last one."""
    odometry = Velocity(x=0.0)  # ask your wheels
    cloud = lidario.merge()
    async with (
        lidario.open_lidar(front) as one,
        lidario.open_lidar(rear) as two,
        one.scans() as ahead,
        two.scans() as behind,
    ):
        while count:
            # Both at the same time: else the second one would be a revolution older.
            pair = await asyncio.gather(anext(ahead), anext(behind))
            if abs(pair[0].stamp_ns - pair[1].stamp_ns) > TOO_OLD_S * 1e9:
                print("one of them was late")
                continue
            count -= 1
            cloud = together(*pair, odometry)
            spread_ms = np.ptp(cloud.times_ns) * 1e-6
            print(f"{len(cloud)} points of {cloud.source.max() + 1} lidars, measured within {spread_ms:.0f} ms")
    return cloud


if __name__ == "__main__":
    lidario.run(main(sys.argv[1], sys.argv[2])) if len(sys.argv) == 3 else sys.exit(__doc__)
