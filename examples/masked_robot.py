"""Two lidars on a robot: its body left out, both as one, a stop before obstacles, all of it published to ROS 2.

python masked_robot.py FRONT REAR lidario.toml
"""

import sys

import numpy as np

import lidario
from lidario.ros import MergedPublisher

STOP_M = 0.5


async def main(
    front: str, rear: str, settings: str, count: int | None = None, router: str = "tcp/localhost:7447"
) -> None:
    """Read both until Ctrl-C, or so many clouds; the settings say the mounts and the robot's body."""
    async with (
        lidario.open_lidar(front, config=settings, reconnect=True) as one,
        lidario.open_lidar(rear, config=settings, reconnect=True) as two,
        MergedPublisher([one, two], router=router) as publisher,
        lidario.merged(one, two) as clouds,
    ):
        async for cloud in clouds:
            publisher.publish(cloud)
            nearest = np.linalg.norm(cloud.points.xy, axis=1).min(initial=np.inf)
            if cloud.missing or nearest < STOP_M:
                print(f"stop: {nearest:.2f} m" if not cloud.missing else f"stop: lidar {cloud.missing} is silent")
            if (count := None if count is None else count - 1) == 0:
                return


if __name__ == "__main__":
    lidario.run(main(sys.argv[1], sys.argv[2], sys.argv[3]))
