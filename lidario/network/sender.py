"""Publishing under one key of zenoh's."""

from __future__ import annotations

import logging
import time
from typing import Any

from lidario.network.keys import Attachment

_log = logging.getLogger("lidario")


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


def declare(session: Any, key: str, *, keeps_last: bool) -> Any:
    """A publisher of zenoh's; one that keeps its last message for those who come later, if that is wanted."""
    import zenoh

    # Where a router does not keep up, messages are lost: the lidar does not wait.
    drop = zenoh.CongestionControl.DROP
    if not keeps_last:
        return session.declare_publisher(key, congestion_control=drop)
    from zenoh import ext

    # As rmw_zenoh declares its publishers that are transient local (docs/design.md). Messages are told apart by
    # numbers: clients have no time stamps unless they are configured so.
    cache, numbers = (
        ext.CacheConfig(max_samples=1),
        ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
    )
    return ext.declare_advanced_publisher(
        session, key, congestion_control=drop, cache=cache, sample_miss_detection=numbers, publisher_detection=True
    )
