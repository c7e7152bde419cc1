"""What is believed of responses: they carry no check value, and one flipped bit makes another device.

So what decides how a device is read, or what is done to it, is asked until it comes twice alike.
"""

from __future__ import annotations

import struct
from typing import Final

from lidario.errors import RemoteProtocolError, ResponseTimeout
from lidario.families.base import Script
from lidario.model import Health, HealthStatus
from lidario.wire.envelope import Request

STATUSES: Final = (HealthStatus.OK, HealthStatus.WARNING, HealthStatus.ERROR)
"""Health by its number, the same in every family so far."""
MOST_DIFFERENT: Final = 5
"""Responses that are all different, after which no more are asked for."""


def agreed(request: Request, *told: bytes) -> Script[bytes]:
    """Ask until two responses are equal; one that has responded may miss the question once.

    Args:
        request: What is asked.
        told: Responses that came before.

    Raises:
        RemoteProtocolError: Five responses were all different.
        ResponseTimeout: None came, or twice none behind others.
    """
    seen, missed = set(told), False
    while len(seen) < MOST_DIFFERENT:
        try:
            payload = yield request
        except ResponseTimeout:
            if missed or not seen:
                raise
            missed = True
            continue
        if payload in seen:
            return payload
        seen.add(payload)
    raise RemoteProtocolError(
        f"{MOST_DIFFERENT} responses to {request.name} were all different: the line damages what it carries"
    )


def health_of(request: Request, told: bytes) -> Script[Health]:
    """Status and code, by the response that came to `request`.

    An error has the device reset: so it is believed when it came twice. A status that no document defines is a
    warning: only an error is known to be one.
    """
    status, code = struct.unpack("<BH", (yield from agreed(request, told)) if any(told) else told)
    if status < len(STATUSES):
        return Health(STATUSES[status], code)
    return Health(HealthStatus.WARNING, code, f"it reports health status {status}, which is not defined")
