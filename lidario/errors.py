"""Every exception lidario raises, in one tree.

::

    LidarError
    ├── ConnectFailed            could not open or identify the device; the text says why, and the cure
    ├── DeviceLost               the port died, or a stream fell silent, while open
    ├── SessionClosed            used after close
    ├── Busy                     a second reader of one stream, or a port somebody else holds
    ├── ResponseTimeout          no answer to a request in time; also a TimeoutError
    ├── ProtocolError
    │   ├── LocalProtocolError   asked for something that is illegal in this state
    │   └── RemoteProtocolError  the device gave an answer that cannot be
    ├── DeviceFault              the device reports an error that a reset did not cure
    └── Unsupported              this device or firmware lacks the command or mode

Noise on the line is none of these: bad bytes are counted in `Stats`, never raised. Exceptions of the
operating system and of pyserial are translated in `lidario.port` and stay reachable as `__cause__`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lidario.model import Health

__all__ = [
    "Busy",
    "ConnectFailed",
    "DeviceFault",
    "DeviceLost",
    "LidarError",
    "LocalProtocolError",
    "ProtocolError",
    "RemoteProtocolError",
    "ResponseTimeout",
    "SessionClosed",
    "Unsupported",
]


class LidarError(Exception):
    """Base of every exception lidario raises on purpose."""


class ConnectFailed(LidarError):
    """The device could not be opened or identified.

    Attributes:
        reason: One word for programs: ``missing``, ``permission``, ``busy``, ``silent``, ``refused``,
            ``ambiguous`` or ``source`` (the source itself makes no sense).
    """

    def __init__(self, message: str, *, reason: str = "silent") -> None:
        super().__init__(message)
        self.reason = reason


class DeviceLost(LidarError):
    """The port died or the stream fell silent; every stream and waiter of the session ends with it."""


class SessionClosed(LidarError):
    """The session was closed before or during this call."""


class Busy(LidarError):
    """Two tasks wanted what only one may have at a time."""


class ResponseTimeout(LidarError, TimeoutError):
    """The device gave no answer to a request in time.

    Attributes:
        request: Name of the request that went unanswered.
        noise: Bytes that arrived meanwhile and were no answer to it.
    """

    def __init__(self, request: str, timeout: float, noise: int = 0) -> None:
        came = f"{noise} bytes came that are no answer to it" if noise else "nothing came back"
        super().__init__(f"no answer to {request} within {timeout:g} s: {came}")
        self.request = request
        self.noise = noise


class ProtocolError(LidarError):
    """The rules of the protocol were broken; see the two subclasses for whose fault it is."""


class LocalProtocolError(ProtocolError):
    """The caller asked for something that is illegal in the current state."""


class RemoteProtocolError(ProtocolError):
    """The device gave an answer that cannot be right."""


class DeviceFault(LidarError):
    """The device reports an error state that a reset did not cure.

    Attributes:
        health: What the device last said of itself.
    """

    def __init__(self, message: str, health: Health) -> None:
        super().__init__(message)
        self.health = health


class Unsupported(LidarError):
    """This device or firmware lacks the command, the mode or the format."""
