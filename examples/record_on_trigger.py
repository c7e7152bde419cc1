"""Record only when something happens: here, while anything is nearer than a metre.

    python record_on_trigger.py [SOURCE]

Each event is a file of its own, event-0.mcap, event-1.mcap, ... "lidario info" and "lidario view" open them.
Recordings need the package mcap: pip install mcap.
"""

import sys
from contextlib import suppress
from pathlib import Path

import lidario

NEAR_M = 1.0
CALM_SCANS = 10  # for so long nothing is near before a recording ends


async def main(
    source: str | lidario.SimulatedDevice = "auto", folder: str | Path = ".", events: int = 1
) -> list[Path]:
    """Record so many events; returns the files."""
    files: list[Path] = []
    async with lidario.open_lidar(source) as lidar, lidar.scans(depth=8) as scans:
        while len(files) < events:
            async for scan in scans:
                if is_near(scan):
                    break
            files.append(Path(folder) / f"event-{len(files)}.mcap")
            print("something is near: recording", files[-1])
            async with lidar.record(files[-1]) as recording:
                calm = 0
                async for scan in scans:
                    calm = 0 if is_near(scan) else calm + 1
                    if calm == CALM_SCANS:
                        break
            print(f"{recording.scans} scans, {recording.size} bytes")
    return files


def is_near(scan: lidario.Scan) -> bool:
    """Whether this scan is worth a recording."""
    nearest = scan.nearest()
    return nearest is not None and nearest.range < NEAR_M


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        lidario.run(main(sys.argv[1] if len(sys.argv) > 1 else "auto"))
