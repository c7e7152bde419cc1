"""Publishing under one key of zenoh's."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

__all__ = ["Sender", "declare"]

_log = logging.getLogger("lidario")


class Sender:
    """Publishes under one key."""

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    def watch(self, changed: Callable[[Any], None]) -> Any:
        """Have `changed` called in a thread of zenoh whenever the first reader comes or the last one goes."""
        return self._publisher.declare_matching_listener(changed)

    def put(self, payload: bytes, attachment: bytes) -> bool:
        """Send it; False where it could not be sent. While there is no router it is lost, without an error."""
        try:
            self._publisher.put(payload, attachment=attachment)
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
