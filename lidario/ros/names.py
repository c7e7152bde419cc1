"""How a publisher is named so that nodes of rmw_zenoh_cpp see it: keys, tokens, quality of service.

All of it is from rmw_zenoh's docs/design.md (@99a6a2bd) and its ``liveliness_utils.cpp``:

* messages go to ``DOMAIN/NAME/DDS_TYPE/TYPE_HASH``, the name without its outer slashes;
* a node is a liveliness token ``@ros2_lv/DOMAIN/ZID/NODE/NODE/NN/ENCLAVE/NAMESPACE/NAME``;
* a publisher is ``@ros2_lv/DOMAIN/ZID/NODE/ENTITY/MP/…``: the same, then topic, type, hash and QoS;
* in tokens every ``/`` of a name becomes ``%``, and what is empty is ``%``.

The type hashes are those of the message definitions (REP-2011); the tests compute them. ROS 2 Humble knows none,
and its nodes have a word in their place (rmw_zenoh PR 388).
"""

import hashlib
import re
from dataclasses import dataclass
from typing import Final, Literal, get_args

from lidario.basics.arguments import shown, text_of, whole
from lidario.errors import InvalidValue

Distro = Literal["humble", "jazzy", "kilted", "lyrical"]
DISTROS: Final[tuple[Distro, ...]] = get_args(Distro)

NO_HASH: Final = "TypeHashNotSupported"
"""What nodes of Humble have in the place of the hash. With a hash they list a topic, and drop its messages."""
RELIABLE_10: Final = "::,10:,:,:,,"
"""Quality of service of a publisher as most nodes have it: reliable, volatile, the last 10. A field that equals the
default is empty. Readers are never refused because of it (rmw_zenoh's docs/design.md)."""
LATEST_KEPT: Final = ":1:,1:,:,:,,"  # transient local, the last one: who comes later gets it too
MOST_DOMAIN: Final = 232

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_LONGEST: Final = 200


@dataclass(frozen=True, slots=True)
class MessageType:
    """One type of message."""

    dds: str  # its name in keys
    hash: str  # its hash in keys

    def part(self, distro: Distro) -> str:
        """Both, as they stand in a key."""
        return f"{self.dds}/{NO_HASH if distro == 'humble' else self.hash}"


LASERSCAN: Final = MessageType(
    "sensor_msgs::msg::dds_::LaserScan_",
    "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
)
POINTCLOUD2: Final = MessageType(
    "sensor_msgs::msg::dds_::PointCloud2_",
    "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
)
DIAGNOSTICS: Final = MessageType(
    "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
)


TF_MESSAGE: Final = MessageType(
    "tf2_msgs::msg::dds_::TFMessage_",
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
)
CLOCK: Final = MessageType(
    "rosgraph_msgs::msg::dds_::Clock_",
    "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
)


@dataclass(frozen=True, slots=True)
class Node:
    """One node of ROS 2.

    Attributes:
        name: Its name.
        namespace: Such as ``/robot1``, also given without the slash; ``/`` for none.
        domain: ``ROS_DOMAIN_ID``.
        distro: Which release of ROS 2 the other nodes are of.

    Raises:
        InvalidValue: One of them cannot be right.
    """

    name: str = "lidario"
    namespace: str = "/"
    domain: int = 0
    distro: Distro = "jazzy"

    def __post_init__(self) -> None:
        if text_of(self.namespace, "a namespace") != "/":
            object.__setattr__(self, "namespace", qualified(self.namespace, "/"))
        text_of(self.name, "the name of a node")
        if not _NAME.fullmatch(self.name) or len(self.name) > _LONGEST:
            raise InvalidValue(f"{self.name!r} is not the name of a node: letters, digits and _ are")
        if not 0 <= whole(self.domain, "a domain") <= MOST_DOMAIN:
            raise InvalidValue(f"a domain is a number from 0 to {MOST_DOMAIN}, not {shown(self.domain)}")
        if text_of(self.distro, "a release of ROS 2") not in DISTROS:
            raise InvalidValue(f"{shown(self.distro)} is not known; these are: {', '.join(DISTROS)}")

    def topic(self, name: str) -> str:
        """The full name of a topic: ``/scan`` for ``scan``; one that begins with a slash is full already."""
        return qualified(name, self.namespace)

    def data_key(self, topic: str, kind: MessageType) -> str:
        """Where the messages of a topic go; `topic` is a full name."""
        return f"{self.domain}/{topic.strip('/')}/{kind.part(self.distro)}"

    def node_token(self, zid: str) -> str:
        """The token that shows the node; `zid` is the id of the zenoh session."""
        return f"@ros2_lv/{self.domain}/{zid}/0/0/NN/%/{_mangled(self.namespace)}/{self.name}"

    def publisher_token(
        self, zid: str, entity: int, topic: str, kind: MessageType, quality: str = RELIABLE_10
    ) -> str:
        """The token that shows a publisher; each has its own `entity` number, from 1 on."""
        return (
            f"@ros2_lv/{self.domain}/{zid}/0/{entity}/MP/%/{_mangled(self.namespace)}/{self.name}/"
            f"{_mangled(topic)}/{kind.part(self.distro)}/{quality}"
        )


def qualified(name: str, namespace: str) -> str:
    """The full name of a topic.

    Raises:
        InvalidValue: It cannot be one.
    """
    text_of(name, "a name in ROS")
    full = name if name.startswith("/") else f"{namespace.rstrip('/')}/{name}"
    if len(full) > _LONGEST or not all(_NAME.fullmatch(part) for part in full[1:].split("/")):
        raise InvalidValue(
            f"{name!r} is not a name in ROS: letters, digits and _, with / between, such as front/scan"
        )
    return full


def gid_of(token: str) -> bytes:
    """16 bytes that tell a publisher.

    rmw_zenoh takes another hash (XXH3) of the same text; receivers copy the bytes and compare them with nothing.
    """
    return hashlib.blake2b(token.encode(), digest_size=16).digest()


def _mangled(name: str) -> str:
    return name.replace("/", "%") or "%"
