"""Reads a lidar and notes when it would stop: as PATH, scans or sectors, HZ, SECONDS.

It prints the times at which something near was found, nanoseconds on the clock that all processes share, as JSON.
"""

from __future__ import annotations

import json
import sys
import time

import lidario

__all__ = ["NEAR_M", "main"]

NEAR_M = 1.0
DEGREES = 45.0


async def main(path: str, kind: str, hertz: float, seconds: float) -> list[int]:
    """Read for so many seconds from the first part on."""
    stops: list[int] = []
    async with lidario.open_lidar(path) as lidar:
        await lidar.set_scan_frequency(hertz)
        async with lidar.sectors(DEGREES) if kind == "sectors" else lidar.scans() as parts:
            end = 0.0
            async for part in parts:
                near = part.nearest()
                if near is not None and near.range < NEAR_M:
                    stops.append(time.monotonic_ns())  # here a robot calls stop
                end = end or time.monotonic() + seconds
                if time.monotonic() > end:
                    break
    return stops


if __name__ == "__main__":
    print(json.dumps(lidario.run(main(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4])))))
