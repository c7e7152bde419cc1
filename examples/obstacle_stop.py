"""A robot that stops in front of obstacles, at any moment of its control loop of 20 Hz.

    python obstacle_stop.py [SOURCE]

One task reads the lidar and keeps the nearest distance ahead. The control loop never waits for the lidar. It stops
also where nothing has come for a while: an old distance is worse than none.
"""

import asyncio
import math
import sys

import lidario

AHEAD = (-0.35, 0.35)  # radians: what the robot would hit
STOP_M = 0.5
TOO_OLD_S = 0.3
TICK_S = 0.05


class Eyes:
    """What is ahead, as far as is known."""

    distance = math.inf
    seen_at = -math.inf

    async def watch(self, lidar: lidario.Lidar) -> None:
        """Read until the lidar is closed."""
        loop = asyncio.get_running_loop()
        async for scan in lidar.scans():
            ahead = scan.nearest(between=AHEAD)
            self.distance = ahead.range if ahead else math.inf
            self.seen_at = loop.time()


async def drive(source: str | lidario.SimulatedDevice, *, seconds: float = 5.0) -> float:
    """Drive until something is near; returns the distance at which the robot stopped, infinite where it did not."""
    loop = asyncio.get_running_loop()
    async with lidario.open_lidar(source, reconnect=True) as lidar, asyncio.TaskGroup() as tasks:
        eyes = Eyes()
        watching = tasks.create_task(eyes.watch(lidar))
        end = loop.time() + seconds
        while loop.time() < end and eyes.distance >= STOP_M:
            is_blind = loop.time() - eyes.seen_at > TOO_OLD_S
            set_wheels(0.0 if is_blind else 0.4)
            await asyncio.sleep(TICK_S)
        set_wheels(0.0)
        watching.cancel()
    return eyes.distance if eyes.distance < STOP_M else math.inf


def set_wheels(speed: float) -> None:
    """Metres a second; tell your wheels here."""


if __name__ == "__main__":
    source = sys.argv[1] if len(sys.argv) > 1 else "auto"
    print(f"stopped at {lidario.run(drive(source)):.2f} m")
