"""Several lidars as one publisher of ROS 2: one LaserScan and one PointCloud2, in the robot's frame."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from lidario.basics.arguments import shown
from lidario.basics.model import HealthStatus
from lidario.errors import InvalidValue
from lidario.network.bus import DEFAULT_ROUTER, Bus
from lidario.network.keys import Sender
from lidario.network.status import Status
from lidario.recording.about import About
from lidario.ros.names import POINTCLOUD2, Distro
from lidario.ros.pointcloud import POINT, PointCloud2
from lidario.ros.publisher import Publisher
from lidario.scans.beams import NoReturn
from lidario.scans.merging import Merged
from lidario.scans.points import Motion, Mount
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar
from lidario.session.merged import MergedStream, merged

CLOUD_ENTITY: Final = 5
"""Behind those of `Publisher`."""
_WORSE: Final = tuple(HealthStatus)
"""From good to bad."""


class MergedPublisher(Publisher):
    """Several lidars as one publisher of ROS 2; used as an asynchronous context manager.

    ::

        async with MergedPublisher([front, rear]) as publisher:
            await publisher.run()

    Or call `publish` with each cloud of `lidario.merged`. The list of a fleet names all of the lidars, the worst
    health among them, and those that are away; ``/diagnostics`` tells of each. `run` ends where another task stops
    them all: the others go on without the one that is stopped.

    Args:
        lidars: Open lidars of this event loop.
        mounts: Where each is on the robot; None for those of the file of settings.
        motion: How the robot moves, as for `Scan.points`; None for not at all.
        topic: Name of the topic of the LaserScans, relative to `namespace` unless it begins with a slash.
        cloud_topic: Likewise of the PointCloud2.
        frame_id: Name of the robot's frame, in which all of it is.

    The other arguments are those of `Merged.to_laserscan` and of `Publisher`.

    Raises:
        InvalidValue: As `Publisher` and `lidario.merged`.
    """

    def __init__(
        self,
        lidars: Sequence[Lidar],
        *,
        mounts: Sequence[Mount] | None = None,
        motion: Motion | None = None,
        topic: str = "scan",
        cloud_topic: str = "cloud",
        frame_id: str = "base_link",
        beams: int = 720,
        range_min: float = 0.05,
        range_max: float | None = None,
        no_return: NoReturn = "inf",
        filtered: NoReturn = "nan",
        domain: int = 0,
        distro: Distro = "jazzy",
        router: str = DEFAULT_ROUTER,
        namespace: str = "/",
        node: str = "lidario",
        robot: str | None = None,
    ) -> None:
        merged(*lidars, mounts=mounts, motion=motion)
        super().__init__(
            lidars[0], topic=topic, frame_id=frame_id, beams=beams, range_min=range_min, range_max=range_max,
            no_return=no_return, filtered=filtered, domain=domain, distro=distro, router=router,
            namespace=namespace, node=node, robot=robot,
        )  # fmt: skip
        self.lidars: tuple[Lidar, ...] = tuple(lidars)
        self._sessions = self.lidars
        self._mounts, self._motion = mounts, motion
        self._message_of = partial(
            Merged.to_laserscan, beams=beams, frame_id=frame_id, range_min=range_min, range_max=range_max,
            no_return=no_return, filtered=filtered,
        )  # fmt: skip
        self._cloud_topic = self._node.topic(cloud_topic)
        self._cloud: Sender | None = None

    def publish(self, scan: Scan | Merged) -> None:
        """Publish a cloud of `lidario.merged`. Never waits: without a router it is lost.

        Raises:
            InvalidValue: It is no `Merged`.
        """
        if not isinstance(scan, Merged):
            raise InvalidValue(
                f"a publisher of several lidars takes what lidario.merged() gives, not {shown(scan)}"
            )
        message = self._message_of(scan).to_cdr()
        if self._cloud is not None:
            self._cloud.send(_cloud_of(scan, self._messages.frame_id).to_cdr())
        self._count(self._scans is not None and self._scans.send(message))

    def status(self) -> Status:
        """As `Publisher.status`, of all the lidars."""
        away = " and ".join(each.info.serial for each in self.lidars if not each.is_connected)
        return replace(super().status(), lost=f"{away} is away from its publisher" if away else "")

    def _about(self) -> About:
        infos = [lidar.info for lidar in self.lidars]
        model, serial = (" and ".join(each) for each in zip(*((of.model, of.serial) for of in infos), strict=True))
        worst = max((lidar.health for lidar in self.lidars), key=lambda health: _WORSE.index(health.status))
        return replace(super()._about(), info=replace(infos[0], model=model, serial=serial), health=worst)

    def _stream(self, mode: str | int | None) -> MergedStream:
        return merged(*self.lidars, mounts=self._mounts, motion=self._motion, mode=mode)

    def _declare(self, bus: Bus) -> bytes:
        identity = super()._declare(bus)
        self._cloud = self._outlet(bus, CLOUD_ENTITY, self._cloud_topic, POINTCLOUD2)
        self._watch_readers(bus, self._cloud)
        return identity

    def _each_second(self, status: Status) -> None:
        for lidar in self.lidars:
            self._diagnose(lidar, f"{self.topic.lstrip('/')} {lidar.info.serial}", status.rate)


def _cloud_of(scan: Merged, frame_id: str) -> PointCloud2:
    """All points, at the instant of the message: the field ``t`` is 0."""
    points = np.zeros(len(scan), POINT)
    points["x"], points["y"] = scan.points.xy.T
    if scan.points.intensities is not None:
        points["intensity"] = scan.points.intensities
    return PointCloud2(scan.wall_at_ns, frame_id, points)
