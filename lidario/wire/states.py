"""The states of `Link`.

::

    IDLE ──request with a response──> AWAIT_RESPONSE ──response, forget()──> IDLE
                                            ├──descriptor of a stream──> STREAMING ──STOP──> DRAINING
                                            └──the same, after abandon()──> DRAINING ──drained()──> IDLE

STOP and RESET lead to DRAINING; from AWAIT_RESPONSE they do what `abandon()` does, since the device may be busy and
not have heard them. A device that streams unasked cannot be told to stop: its STOP has no bytes and leads to IDLE,
where what it sends on counts as drained. Its stream has no descriptor: the request for it leads to STREAMING at
once, and a request for packets has so many of them as its response.
"""

from __future__ import annotations

from enum import Enum


class LinkState(Enum):
    """What the link makes of arriving bytes."""

    IDLE = "idle"
    AWAIT_RESPONSE = "await response"
    STREAMING = "streaming"
    DRAINING = "draining"
