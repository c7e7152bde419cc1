"""A robot that stops in front of obstacles, at any moment of its control loop of 20 Hz.

    python obstacle_stop.py [SOURCE]

One task reads the lidar in sectors, each as soon as it is measured, and keeps the nearest distance ahead. The
control loop never waits for it, and stops also where nothing has come for a while: it does not drive blind.
"""

import asyncio
import math
import sys

import lidario

AHEAD = (-0.35, 0.35)  # radians: what the robot would hit
STOP_M, TOO_OLD_S = 0.5, 0.2


class Eyes:
    """What is ahead, as far as is known."""

    def __init__(self) -> None:
        self.nearest: dict[int, float] = {}  # of each sector
        self.seen_at = -math.inf

    @property
    def distance(self) -> float:
        """Metres; infinite where nothing is."""
        return min(self.nearest.values(), default=math.inf)

    async def watch(self, lidar: lidario.Lidar) -> None:
        """Read until the lidar is closed."""
        async for sector in lidar.sectors(degrees=45):
            ahead = sector.nearest(between=AHEAD)
            self.nearest[sector.index] = ahead.range if ahead else math.inf
            self.seen_at = asyncio.get_running_loop().time()


async def drive(source: str | lidario.SimulatedDevice, *, seconds: float = 5.0) -> float:
    """Drive until something is near; returns the distance at which the robot stopped, infinite where it did not."""
    loop = asyncio.get_running_loop()
    async with lidario.open_lidar(source, reconnect=True) as lidar, asyncio.TaskGroup() as tasks:
        eyes = Eyes()
        watching = tasks.create_task(eyes.watch(lidar))
        end = loop.time() + seconds
        while loop.time() < end and eyes.distance >= STOP_M:
            set_wheels(0.0 if loop.time() - eyes.seen_at > TOO_OLD_S else 0.4)
            await asyncio.sleep(0.05)
        set_wheels(0.0)
        watching.cancel()
    return eyes.distance if eyes.distance < STOP_M else math.inf


def set_wheels(speed: float) -> None:
    """Metres a second; tell your wheels here."""


if __name__ == "__main__":
    print(lidario.run(drive(sys.argv[1] if len(sys.argv) > 1 else "auto")), "m")
