"""Every exception lidario raises, in one tree.

::

    LidarError
    ├── ConnectFailed            could not open or identify the device; the text says why, and the cure
    ├── DeviceLost               the port died while it was open: the session is over
    ├── StreamFailed             a running stream ended by itself: the session goes on
    ├── InternalError            lidario itself failed: a mistake of ours; the session is over
    ├── SessionClosed            used after close
    ├── Busy                     a second task reads one stream
    ├── RecordingError           a recording in which nothing can be read
    ├── InvalidValue             an argument that cannot be right; also a ValueError
    ├── ResponseTimeout          no response to a request in time; also a TimeoutError
    ├── ProtocolError
    │   ├── LocalProtocolError   asked for something that is illegal in this state
    │   └── RemoteProtocolError  the device sent a response that cannot be right
    ├── DeviceFault              the device reports an error that a reset did not clear
    ├── CannotRecord             a recording cannot be written, or not any further
    └── Unsupported              this device or firmware lacks the command or mode

Noise on the line is none of these: damaged bytes are counted in `Stats`, never raised. Exceptions of the
operating system and of pyserial are translated where the port is opened and read; the original is the
``__cause__`` of the translated one.

One error may end several readers at once. Each reader gets a copy of its own (`copy.copy`), so that the
tracebacks do not mix. Therefore every class can be copied and pickled: ``args`` holds exactly what
``__init__`` needs.
"""

from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from lidario.basics.words import counted

if TYPE_CHECKING:
    from lidario.basics.model import Health

ConnectReason: TypeAlias = Literal["missing", "permission", "busy", "silent", "refused", "ambiguous", "source"]
"""Why a connection failed, in one word for programs; `ConnectFailed` explains each."""


class LidarError(Exception):
    """Base of every exception lidario raises on purpose."""


class ConnectFailed(LidarError):
    """The device could not be opened or identified.

    Attributes:
        reason: One word for programs:

            * ``missing``: no such port, no lidar found, none published under a zenoh key, or no such host of a
              zenoh router;
            * ``permission``: this user may not open the port;
            * ``busy``: another program holds the port;
            * ``silent``: the port opened, but no lidar responds;
            * ``refused``: the network host refuses the connection or cannot be reached;
            * ``ambiguous``: several lidars respond and none was named;
            * ``source``: the text that names the device is wrong.
    """

    def __init__(self, message: str, *, reason: ConnectReason = "silent") -> None:
        super().__init__(message)
        self.reason: ConnectReason = reason


class DeviceLost(LidarError):
    """The port died while it was open: unplugged, or closed at the other end.

    The session is over. Every stream and every waiting call ends with this error, and so does every later call.
    With `open_lidar(reconnect=...)` only those calls raise it that cannot be done while the device is away, and the
    session is over when it has given up.
    """


class StreamFailed(LidarError):
    """A stream ended by itself.

    It sent no data, its samples never completed a revolution, or it could not be started again after an
    interruption. The device was asked then: it does not respond, or it is well and a restart is of no use. Once
    packets flow, that takes less than a second; before the first one, as long as the rotor may need. Every reader
    of the stream gets this error. The session goes on: requests are still sent, and a new stream can be started.
    """


class InternalError(LidarError):
    """Lidario itself failed while it processed what the device sent; the original error is among its causes.

    This is a mistake in lidario: please report it with the traceback. The session is over, as after `DeviceLost`.
    """


class SessionClosed(LidarError):
    """The session was closed before or during this call."""


class Busy(LidarError):
    """A second task reads a stream, or runs a publisher, as another task does already. Each needs its own."""


class RecordingError(LidarError):
    """Nothing can be read in a recording: it holds no measurement stream, or none of the family that was named."""


class InvalidValue(LidarError, ValueError):
    """An argument cannot be right: out of range, not a number, or not finite. Nothing was changed."""


class ResponseTimeout(LidarError, TimeoutError):
    """The device sent no response to a request in time.

    Attributes:
        request: Name of the request that got no response.
        timeout: Seconds that were waited.
        noise: Bytes that arrived meanwhile and were no response to it.
    """

    def __init__(self, request: str, timeout: float, noise: int = 0) -> None:
        super().__init__()
        # Set here, because OSError.__init__ would read two or three arguments as errno, strerror and filename.
        self.args: tuple[Any, ...] = (request, timeout, noise)
        self.request = request
        self.timeout = timeout
        self.noise = noise

    def __str__(self) -> str:
        noise = f"{counted(self.noise, 'byte')} arrived, but no response to it"
        return (
            f"no response to {self.request} within {self.timeout:g} s: {noise if self.noise else 'nothing arrived'}"
        )


class ProtocolError(LidarError):
    """The rules of the protocol were broken; the subclass tells by which side."""


class LocalProtocolError(ProtocolError):
    """The caller asked for something that is illegal in the current state."""


class RemoteProtocolError(ProtocolError):
    """The device sent a response that cannot be right."""


class DeviceFault(LidarError):
    """The device reports an error state that a reset did not clear, or that came again within a minute.

    Attributes:
        health: The health that the device reported last.
    """

    def __init__(self, message: str, health: "Health") -> None:
        super().__init__(message, health)
        self.health = health

    def __str__(self) -> str:
        return str(self.args[0])


class Unsupported(LidarError):
    """This device or firmware lacks the command, the mode or the format."""


class CannotRecord(LidarError):
    """A recording cannot be written, or not any further: no permission, no space, or a disk that is too slow."""
