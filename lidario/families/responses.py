"""What is believed of responses: they carry no check value, and one flipped bit makes another device.

So what decides how a device is read, or what is done to it, is asked until it comes twice alike.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final

from lidario.errors import RemoteProtocolError, ResponseTimeout
from lidario.families.base import Script
from lidario.model import Health, HealthStatus
from lidario.wire.envelope import Request

__all__ = ["agreed", "ask_health"]

STATUSES: Final = (HealthStatus.OK, HealthStatus.WARNING, HealthStatus.ERROR)
"""Health by its number, the same in every family so far."""
MOST_DIFFERENT: Final = 5


def agreed(request: Request) -> Script[bytes]:
    """Ask until two responses are equal; one that has responded once may miss a question later.

    Raises:
        RemoteProtocolError: Five responses were all different.
        ResponseTimeout: None came.
    """
    seen: set[bytes] = set()
    for _ in range(MOST_DIFFERENT):
        try:
            payload = yield request
        except ResponseTimeout:
            if not seen:
                raise
            continue
        if payload in seen:
            return payload
        seen.add(payload)
    raise RemoteProtocolError(
        f"{MOST_DIFFERENT} responses to {request.name} were all different: the line damages what it carries"
    )


def ask_health(ask: Callable[[], Script[bytes]]) -> Script[Health]:
    """Health as status and code; trouble is believed when it comes twice, since the device is reset for an error.

    Args:
        ask: Asks once.
    """
    payload = yield from ask()
    while payload[0] and (again := (yield from ask())) != payload:
        payload = again
    return _health_of(*struct.unpack("<BH", payload))


def _health_of(status: int, code: int) -> Health:
    """A warning where no document defines the number: only an error is known to be one."""
    if status < len(STATUSES):
        return Health(STATUSES[status], code)
    return Health(HealthStatus.WARNING, code, f"it reports health status {status}, which is not defined")
