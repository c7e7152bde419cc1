"""Every lidar that is alive anywhere: from its liveliness token, and from what its publisher responds.

A token is there as long as the process that declared it. It goes at once when that process ends or is killed. When
its machine is cut off, it goes after the lease of its connection to the router: ten seconds unless configured
otherwise.
"""

import re
from dataclasses import dataclass
from typing import Final

from lidario.basics.model import Health
from lidario.network.bus import DEFAULT_ROUTER, Bus
from lidario.network.keys import LASERSCAN_IN_KEY, parse_token, tokens_of
from lidario.network.status import ASK_S, statuses

ALL_LASERSCANS: Final = "@ros2_lv/*/*/*/*/MP/*/*/*/*/sensor_msgs::msg::dds_::LaserScan_/*/*"
_ROS_TOKEN: Final = re.compile(
    r"@ros2_lv/(\d+)/[^/]+/\d+/\d+/MP/[^/]+/([^/]+)/([^/]+)/([^/]+)/sensor_msgs::msg::dds_::LaserScan_/[^/]+/[^/]+"
)


@dataclass(frozen=True, slots=True)
class RemoteLidar:
    """A lidar on the network.

    Attributes:
        source: What `open_lidar` takes.
        form: ``scan`` and ``raw`` without ROS, ``ros`` as a topic of ROS 2.
        robot: Name of its robot or machine; the node, where it is not published by lidario.
        model: Its model; empty where nobody tells.
        serial: Its serial number; likewise.
        health: What it last said of its state; None where nobody tells.
        rate: Scans a second; 0 where nobody tells.
        lost: Why it is away from its publisher; empty where it is not.
    """

    source: str
    form: str
    robot: str
    model: str
    serial: str
    health: Health | None = None
    rate: float = 0.0
    lost: str = ""


async def list_remote_lidars(router: str = DEFAULT_ROUTER) -> list[RemoteLidar]:
    """Every lidar that is published through a router and those it is connected to, by source.

    Cancelling leaves nothing open.

    Args:
        router: Address of a zenoh router.

    Raises:
        ConnectFailed: It cannot be reached.
        Unsupported: The package that is needed is not installed.
    """
    async with await Bus.open(router) as bus:
        tokens = await bus.tokens(tokens_of("**"), ASK_S)
        others = await bus.tokens(ALL_LASERSCANS, ASK_S)
        told = dict(await statuses(bus, "**")) if tokens else {}
    found: dict[str, RemoteLidar] = {}
    for token in map(parse_token, tokens):
        if token is None:
            continue
        source = f"zenoh:{_short(token.key)}"
        if (status := told.get(token.key)) is None:
            found[source] = RemoteLidar(source, *token[1:])
        else:
            about = status.about
            found[source] = RemoteLidar(
                source, status.form, status.robot, about.info.model, about.info.serial, about.health, status.rate,
                status.lost,
            )  # fmt: skip
    for match in map(_ROS_TOKEN.fullmatch, others):
        if match is not None:
            domain, namespace, node, topic = match.groups()
            source = f"zenoh:{domain}/{topic.replace('%', '/').strip('/')}/*/*"
            robot = f"{namespace.replace('%', '/').rstrip('/')}/{node}"
            found.setdefault(source, RemoteLidar(source, "ros", robot, "", ""))
    return [found[source] for source in sorted(found)]


def _short(key: str) -> str:
    """The key of a LaserScan without its type and its hash, which nobody wants to type."""
    topic, found, _ = key.partition(LASERSCAN_IN_KEY)
    return f"{topic}/*/*" if found else key
