"""The keys under which a lidar is on the network, and what is sent beside each message.

A lidar is published under a key that its user chooses, such as ``robots/r7/scan``. Beside that, under the same key:

==============================================  ==========================================================
``KEY``                                         the scans
``KEY/@lidario/status``                         what the lidar is and how it is: once a second, and to who asks
``KEY/@lidario/alive/FORM/ROBOT/MODEL/SERIAL``  a liveliness token: there as long as the publisher lives
==============================================  ==========================================================

A part that begins with ``@`` is matched by no wildcard (zenoh's key expressions call it verbatim), so that a reader
of ``robots/**`` gets scans and nothing else.

The attachment of a message is that of rmw_zenoh (its docs/design.md, "Publishers"): a number that begins at 1, the
time, and 16 bytes that tell the publisher.
"""

import logging
import re
import struct
import time
from typing import Any, Final, NamedTuple

from lidario.basics.arguments import text_of
from lidario.errors import InvalidValue

_log = logging.getLogger("lidario")

LASERSCAN_IN_KEY: Final = "/sensor_msgs::msg::dds_::LaserScan_/"
"""What tells that the messages under a key are LaserScans of a ROS 2 node."""
FORMS: Final = ("scan", "raw", "ros")

_TOKEN: Final = re.compile(r"(.+)/@lidario/alive/([^/]+)/([^/]+)/([^/]+)/([^/]+)")
_ATTACHMENT: Final = struct.Struct("<qqB16s")
_GID_SIZE: Final = 16
_LONGEST_KEY: Final = 512
_BAD: Final = re.compile(r"[\x00-\x20#?$\x7f]|//|^/|/$|^$|(?<=[^/*])\*|\*(?![/*]|$)|\*\*\*|\*\*/\*")
"""What zenoh refuses: empty parts, some characters, `*` as a part of a word, and more wildcards than are needed."""
_NOT_IN_TOKEN: Final = re.compile(r"[^A-Za-z0-9._-]")


class Token(NamedTuple):
    """What a liveliness token says, as `RemoteLidar` tells it; and under which key the scans are."""

    key: str
    form: str
    robot: str
    model: str
    serial: str


class Attachment(NamedTuple):
    """What is sent beside a message: its number, nanoseconds since the Unix epoch, and who has sent it."""

    number: int
    time_ns: int
    gid: bytes

    def to_bytes(self) -> bytes:
        """The 33 bytes."""
        return _ATTACHMENT.pack(self.number, self.time_ns, _GID_SIZE, self.gid)


def parse_attachment(data: bytes) -> Attachment | None:
    """What `Attachment.to_bytes` wrote; None for anything else."""
    if len(data) != _ATTACHMENT.size:
        return None
    number, time_ns, size, gid = _ATTACHMENT.unpack(data)
    return Attachment(number, time_ns, gid) if size == _GID_SIZE else None


class Sender:
    """Sends numbered messages under one key by the `publisher` of zenoh; `gid` is 16 bytes that tell who sends.

    Those that were lost for want of a router are among those `sent`, so that a reader sees a gap.
    """

    def __init__(self, publisher: Any, gid: bytes) -> None:
        self.sent: int = 0
        self.gid: bytes = gid
        self.publisher: Any = publisher

    def send(self, payload: bytes) -> bool:
        """Send one message; it is lost where there is no router. False where zenoh did not take it."""
        self.sent += 1
        attachment = Attachment(self.sent, time.time_ns(), self.gid)
        try:
            self.publisher.put(payload, attachment=attachment.to_bytes())
        except Exception as error:
            _log.debug("zenoh did not take a message: %s", error)
            return False
        return True


def check_key(key: str, *, wildcards: bool = False) -> str:
    """The key, if zenoh can take it.

    Raises:
        InvalidValue: It cannot be one, or has a wildcard where one key is needed.
    """
    text_of(key, "a key")
    if len(key) > _LONGEST_KEY or _BAD.search(key) or not key.isprintable():
        raise InvalidValue(f"{key[:60]!r} is not a key, such as robots/r7/scan")
    if "*" in key and not wildcards:
        raise InvalidValue(f"{key!r} names many keys; publish under one")
    if "@" in key and any(part.startswith("@") for part in key.split("/")):
        raise InvalidValue(f"{key!r} has a part that begins with @; those are for the system")
    return key


def status_key(key: str) -> str:
    """Where the status of a lidar is."""
    return f"{key}/@lidario/status"


def token_key(token: Token) -> str:
    """The token itself; characters that could mean something in a key become ``_``."""
    parts = (_NOT_IN_TOKEN.sub("_", part[:60]) or "-" for part in token[1:])
    return f"{token.key}/@lidario/alive/{'/'.join(parts)}"


def tokens_of(key: str) -> str:
    """The tokens of all who publish under a key, which may have wildcards."""
    return f"{key}/@lidario/alive/*/*/*/*"


def parse_token(text: str) -> Token | None:
    """What `token_key` wrote; None for anything else."""
    match = _TOKEN.fullmatch(text)
    return Token(*match.groups()) if match and match[2] in FORMS and text.isprintable() else None
