"""Live scans in Foxglove: open a connection to ws://localhost:8765 there, and a 3D panel.

pip install foxglove-sdk && python foxglove_live.py [SOURCE]
"""

import sys
from contextlib import suppress

import foxglove
from foxglove.channels import LaserScanChannel
from foxglove.messages import LaserScan, Timestamp

import lidario


async def main(source: str | lidario.SimulatedDevice = "auto", *, port: int = 8765) -> None:
    """Send every scan to all that are connected, until cancelled."""
    channel, server = LaserScanChannel("/scan"), foxglove.start_server(port=port)
    print(f"ws://localhost:{server.port}", flush=True)
    try:
        async with lidario.open_lidar(source, reconnect=True) as lidar:
            async for scan in lidar.scans():
                laser = scan.to_laserscan()
                told = LaserScan(
                    timestamp=Timestamp(*divmod(laser.stamp_ns, 10**9)),
                    frame_id=laser.frame_id,
                    start_angle=laser.angle_min,
                    end_angle=laser.angle_max,
                    ranges=laser.ranges.tolist(),
                    intensities=laser.intensities.tolist(),
                )
                channel.log(told, log_time=laser.stamp_ns)
    finally:
        server.stop()


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        lidario.run(main(*sys.argv[1:2]))
