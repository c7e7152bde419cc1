"""Scans in Rerun: live in its viewer, or in a file that it opens.

pip install rerun-sdk
python rerun_live.py [SOURCE [FILE.rrd]]
"""

import math
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import rerun

import lidario


async def main(
    source: str | lidario.SimulatedDevice = "auto", file: str | Path | None = None, *, count: float = math.inf
) -> None:
    """Show so many scans as points in metres: x ahead, y to the left."""
    rerun.init("lidario", spawn=file is None)
    if file is not None:
        rerun.save(file)
    rerun.log("lidar", rerun.ViewCoordinates.FLU, static=True)
    async with lidario.open_lidar(source) as lidar, lidar.scans() as scans:
        async for scan in scans:
            rerun.set_time("time", timestamp=scan.wall_stamp_ns * 1e-9)
            points = np.pad(scan.xy()[scan.valid], ((0, 0), (0, 1)))  # z is 0
            rerun.log("lidar/scan", rerun.Points3D(points, radii=0.01))
            if (count := count - 1) <= 0:
                break
    rerun.disconnect()


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        lidario.run(main(*sys.argv[1:3]))
