"""A lidar as a topic of ROS 2, without ROS: what a node of rmw_zenoh_cpp would send, from plain zenoh.

Scans go to a topic as ``sensor_msgs/LaserScan``, all on one grid (`lidario.scans.laserscans`), the health once a
second to ``/diagnostics``. slam_toolbox, nav2 and RViz take no scan of a frame of which they do not know where it
is: where no robot description says so, it goes to ``/tf_static``. A recording that is published with the stamps of
its day needs nodes whose clock runs by ``/clock`` (``use_sim_time``).
"""

import math
import struct
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal

from lidario.basics.arguments import finite, shown, text_of, yes_or_no
from lidario.errors import InvalidValue
from lidario.network.bus import DEFAULT_ROUTER, Bus
from lidario.network.keys import Sender
from lidario.network.status import AWAY, Status
from lidario.ros.broadcast import Broadcast
from lidario.ros.diagnostics import diagnostics
from lidario.ros.names import (
    CLOCK,
    DIAGNOSTICS,
    LASERSCAN,
    LATEST_KEPT,
    RELIABLE_10,
    TF_MESSAGE,
    Distro,
    MessageType,
    Node,
    gid_of,
)
from lidario.scans.beams import PRESET_YAW, BeamOrder, NoReturn, Preset
from lidario.scans.cdr import LITTLE_ENDIAN, CdrWriter, stamp_bytes
from lidario.scans.laserscan import LaserScan
from lidario.scans.laserscans import LaserScans
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar

_SEVEN: Final = struct.Struct("<7d")


class Publisher(Broadcast):
    """One lidar as a publisher of ROS 2; used as an asynchronous context manager.

    ::

        async with lidario.open_lidar() as lidar, Publisher(lidar, topic="scan", frame_id="laser") as publisher:
            await publisher.run()

    Or call `publish` with the scans you choose.

    Args:
        lidar: An open lidar.
        topic: Name of the topic, relative to `namespace` unless it begins with a slash.
        frame_id: Name of the coordinate frame.
        domain: ``ROS_DOMAIN_ID`` of the other nodes.
        distro: Their release: ``humble`` has other keys than all later ones.
        router: Address of the zenoh router, as ``rmw_zenohd`` prints it.
        namespace: Namespace of the node.
        node: Name of the node.
        robot: Name of this robot, for the list of a fleet; None for the name of this machine.
        mount: Where the lidar is on its robot: metres forward, metres to the left, and radians counter-clockwise.
            It is published once on ``/tf_static``, and nodes that come later get it too; with the preset ``vendor``
            the frame of the scans is turned half round, which is in it. None where a robot description says so.
        base_frame: The frame of the robot, for `mount`.
        stamps: ``measured``: when the first beam was measured. ``now``: as if the revolution were just over, for
            the scans of a recording.
        clock: Whether ``/clock`` tells the time of the latest scan, for nodes with ``use_sim_time``.

    The other arguments are those of `LaserScans`.

    Raises:
        InvalidValue: An argument cannot be right, or `mount` and `mount_yaw` both turn the lidar.
    """

    form = "ros"
    topic: str
    """The full name of the topic."""

    def __init__(
        self,
        lidar: Lidar,
        *,
        topic: str = "scan",
        frame_id: str = "laser",
        domain: int = 0,
        distro: Distro = "jazzy",
        router: str = DEFAULT_ROUTER,
        namespace: str = "/",
        node: str = "lidario",
        robot: str | None = None,
        beams: int | None = None,
        order: BeamOrder = "counter-clockwise",
        range_min: float = 0.05,
        range_max: float | None = None,
        no_return: NoReturn = "inf",
        filtered: NoReturn = "nan",
        mount_yaw: float = 0.0,
        preset: Preset = "rep103",
        mount: tuple[float, float, float] | None = None,
        base_frame: str = "base_link",
        stamps: Literal["measured", "now"] = "measured",
        clock: bool = False,
    ) -> None:
        super().__init__(lidar, router, robot)
        self._node = Node(node, namespace, domain, distro)
        self.topic = self._node.topic(topic)
        self.key: str = self._node.data_key(self.topic, LASERSCAN)
        self._messages = LaserScans(
            beams=beams, order=order, frame_id=frame_id, range_min=range_min, range_max=range_max,
            no_return=no_return, filtered=filtered, mount_yaw=mount_yaw, preset=preset,
        )  # fmt: skip
        self._mount = None if mount is None else _mount_of(mount)
        if self._mount is not None and self._mount[2] and mount_yaw:
            raise InvalidValue("a mount that turns the lidar and mount_yaw would turn it twice: say one of them")
        self._base_frame = text_of(base_frame, "a frame")
        if text_of(stamps, "stamps") not in ("measured", "now"):
            raise InvalidValue(f"stamps are 'measured' or 'now', not {shown(stamps)}")
        self._are_now = stamps == "now"
        self._late_ns = 0
        self._tells_time = yes_or_no(clock, "clock")
        self._scans: Sender | None = None
        self._diagnostics: Sender | None = None
        self._clock: Sender | None = None

    def publish(self, scan: Scan) -> None:
        """Publish a scan as LaserScan; an empty one is left out. Never waits: without a router it is lost.

        The first scans wait until the motor has its speed, or for `close`: until then the grid is not known. Then
        the latest of them is sent; the others are too old for a robot.
        """
        self._late_ns = time.time_ns() - scan.wall_stamp_ns - scan.duration_ns if self._are_now else 0
        self._send(list(self._messages.take(scan)))

    async def close(self) -> None:
        """As `Broadcast.close`; what waits for the grid is sent before."""
        self._send(list(self._messages.rest()))
        await super().close()

    def _send(self, ready: Sequence[tuple[Scan, LaserScan]]) -> None:
        for scan, message in ready[-1:]:
            if self._clock is not None:
                # rosgraph_msgs/Clock has nothing but the time.
                self._clock.send(LITTLE_ENDIAN + stamp_bytes(scan.wall_stamp_ns + scan.duration_ns))
            sent = replace(message, stamp_ns=message.stamp_ns + self._late_ns).to_cdr()
            self._count(self._scans is not None and self._scans.send(sent))

    def _declare(self, bus: Bus) -> bytes:
        bus.token(self._node.node_token(bus.id))
        self._scans = self._outlet(bus, 1, self.topic, LASERSCAN)
        self._diagnostics = self._outlet(bus, 2, "/diagnostics", DIAGNOSTICS)
        if self._mount is not None:
            static = self._outlet(bus, 3, "/tf_static", TF_MESSAGE, keeps_last=True)
            x, y, yaw = self._mount
            # A frame whose 0 is behind looks backwards itself.
            place = x, y, yaw - PRESET_YAW[self._messages.preset]
            static.send(_static_transform(time.time_ns(), self._base_frame, self._messages.frame_id, place))
        if self._tells_time:
            self._clock = self._outlet(bus, 4, "/clock", CLOCK)
        self._watch_readers(bus, self._scans)
        return self._scans.gid

    def _outlet(self, bus: Bus, entity: int, topic: str, kind: MessageType, *, keeps_last: bool = False) -> Sender:
        quality = LATEST_KEPT if keeps_last else RELIABLE_10
        token = self._node.publisher_token(bus.id, entity, topic, kind, quality)
        # The publisher before its token: who sees the token may expect it.
        outlet = bus.sender(self._node.data_key(topic, kind), gid_of(token), keeps_last=keeps_last)
        bus.token(token)
        return outlet

    def _each_second(self, status: Status) -> None:
        self._diagnose(self.lidar, self.topic.lstrip("/"), status.rate)

    def _diagnose(self, lidar: Lidar, what: str, rate: float) -> None:
        """Say on ``/diagnostics`` how a lidar is."""
        name, lost = f"{self._node.name}: {what}", "" if lidar.is_connected else AWAY
        told = diagnostics(time.time_ns(), name, lidar.info, lidar.health, stats=lidar.stats, rate=rate, lost=lost)
        if self._diagnostics is not None:
            self._diagnostics.send(told.to_cdr())


def _mount_of(mount: object) -> tuple[float, float, float]:
    if not isinstance(mount, Sequence) or isinstance(mount, str) or len(mount) != 3:
        raise InvalidValue(f"a mount is x, y and yaw: metres and radians, not {shown(mount)}")
    x, y, yaw = (finite(value, "a mount's x, y and yaw") for value in mount)
    return x, y, yaw


def _static_transform(stamp_ns: int, parent: str, child: str, mount: tuple[float, float, float]) -> bytes:
    """``tf2_msgs/TFMessage`` with one transform, as CDR: where the frame of the lidar is in that of the robot."""
    x, y, yaw = mount
    writer = CdrWriter()
    writer.uint32(1)
    writer.header(stamp_ns, parent)
    writer.text(child)
    writer.align(8)
    writer.raw(_SEVEN.pack(x, y, 0.0, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    return writer.finish()
