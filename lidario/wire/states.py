"""The states of `Link`.

::

    IDLE ──request with a response──> AWAIT_RESPONSE ──response, forget()──> IDLE
                                            ├──descriptor of a stream──> STREAMING ──STOP──> DRAINING
                                            └──the same, after abandon()──> DRAINING ──drained()──> IDLE

STOP and RESET lead to DRAINING. From AWAIT_RESPONSE they do what `abandon()` does, since the device may be busy and
may not have heard them. A device that streams unasked cannot be told to stop: its STOP has no bytes and leads to
IDLE, where further packets count as drained. Its stream has no descriptor: the request for it leads to STREAMING at
once. The response to a request for packets is that many packets.
"""

from enum import Enum


class LinkState(Enum):
    """How the link takes arriving bytes."""

    IDLE = "idle"
    AWAIT_RESPONSE = "await response"
    STREAMING = "streaming"
    DRAINING = "draining"
