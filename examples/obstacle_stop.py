"""A robot that stops in front of obstacles, at any moment of its control loop of 20 Hz.

    python obstacle_stop.py [SOURCE]

One task reads the lidar in sectors, and the control loop never waits for it. It drives only where all that lies
ahead was seen a moment ago: what came once and never again is not free.
"""

import asyncio
import math
import sys
from contextlib import suppress

import numpy as np

import lidario

AHEAD = (-0.35, 0.35)  # radians: what the robot would hit
WIDEST = 0.1  # radians between two samples ahead; what stands between them is not seen
STOP_M = 0.5  # metres
TOO_OLD_S = 0.25


class Eyes:
    """What is ahead, as far as it was seen lately."""

    def __init__(self) -> None:
        self.sectors: dict[int, lidario.Sector] = {}  # the latest of each

    async def watch(self, lidar: lidario.Lidar) -> None:
        """Read until the lidar is closed."""
        async for sector in lidar.sectors(degrees=45):
            self.sectors[sector.index] = sector

    def ahead(self) -> float | None:
        """Metres to the nearest thing ahead, infinite where nothing is; None where a part of it was not seen."""
        oldest_ns = (asyncio.get_running_loop().time() - TOO_OLD_S) * 1e9
        fresh = [sector for sector in self.sectors.values() if sector.stamp_ns > oldest_ns]
        angles = np.sort(np.concatenate([AHEAD, *(sector.angles for sector in fresh)]))
        if np.diff(angles[(angles >= AHEAD[0]) & (angles <= AHEAD[1])]).max() > WIDEST:
            return None
        nearest = [sector.nearest(between=AHEAD) for sector in fresh]
        return min((found.range for found in nearest if found), default=math.inf)


async def drive(source: str | lidario.SimulatedDevice, *, seconds: float = math.inf) -> None:
    """Drive where the way is free, and stand where it is not, or where nobody knows."""
    loop = asyncio.get_running_loop()
    async with lidario.open_lidar(source, reconnect=True) as lidar, asyncio.TaskGroup() as tasks:
        eyes, end, before = Eyes(), loop.time() + seconds, ""
        watching = tasks.create_task(eyes.watch(lidar))
        try:
            while loop.time() < end:
                near = eyes.ahead()
                if near is None:
                    speed, why = 0.0, "stand: what is ahead is not seen"
                elif near < STOP_M:
                    speed, why = 0.0, "stand: something is near"
                else:
                    speed, why = 0.4, "drive"
                set_wheels(speed)
                if why != before:
                    print(why if near is None else f"{why}; the nearest thing ahead: {near:.2f} m", flush=True)
                before = why
                await asyncio.sleep(0.05)
        finally:
            set_wheels(0.0)  # at once, also where reading has failed
        watching.cancel()


def set_wheels(speed: float) -> None:
    """Tell your motors here: metres a second."""


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        lidario.run(drive(sys.argv[1] if len(sys.argv) > 1 else "auto"))
