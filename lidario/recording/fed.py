"""A port that is fed with what was recorded, or with what another machine publishes.

The session above it is the one of a live device. The line waits for the request `PLAY` and sends the descriptor of
the stream that comes next. From the moment the session takes packets, they are handed over with the times at which
they were read. So the scans have the stamps that the live ones had. Whatever else is written goes nowhere.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

from lidario.errors import DeviceLost
from lidario.port.line import Line, Schedule
from lidario.port.port import Port
from lidario.recording.device import PLAY
from lidario.recording.read import StoredStream
from lidario.scans.scan import Scan
from lidario.wire.envelope import encode_descriptor
from lidario.wire.events import Descriptor


class Audience(Protocol):
    """The session, as far as such a port needs it."""

    def restart(self, *, failed: bool = False) -> None:
        """The stream was interrupted here, or had `failed`: start it again."""
        ...

    def set_zero_offset(self, degrees: float, *, behind: bool) -> None:
        """Here another zero-angle offset was chosen, clockwise degrees; it holds as in `Piece`."""
        ...

    def finish(self) -> None:
        """The recording is at its end: end every stream."""
        ...

    def deliver(self, scan: Scan, missed: int) -> None:
        """A scan that came whole; so many are missing since the one before."""
        ...

    @property
    def scans(self) -> int:
        """Scans that were made so far."""
        ...

    @property
    def is_waiting(self) -> bool:
        """Whether every reader has taken all its scans."""
        ...

    def on_taken(self, callback: Callable[[], None]) -> None:
        """Call `callback` each time a reader has taken a scan, or has left; and drop no scan any more."""
        ...


class FedPort(Port, ABC):
    """A port at whose other end no device is; needs a running event loop.

    `baudrate` is the speed of the line as it was; 0 where there was none. The session is the `audience`, which is
    known before it takes packets, as it does while `is_wanted`. `offset_of` tells the zero-angle offset to add
    where the stream has another one.
    """

    def __init__(self, name: str, baudrate: int) -> None:
        super().__init__(name, baudrate)
        self.is_live = False
        self.audience: Audience
        self.is_wanted: bool = False
        self.offset_of: Callable[[float], float] = lambda recorded_deg: recorded_deg
        self.connection_made(_FedLine(self))

    @property
    @abstractmethod
    def stream(self) -> StoredStream:
        """The stream that comes now, or next."""

    @abstractmethod
    def want(self, on: bool) -> None:
        """The session takes packets from now on, or no more."""
        self.is_wanted = on

    def end(self, error: DeviceLost | None = None) -> None:
        """The line is closed, or lost. Harmless when done before."""
        if (line := self._open_line()) is not None:
            line.is_closing, self.is_wanted = True, False
            self.let_go(error)

    @abstractmethod
    def let_go(self, error: DeviceLost | None) -> None:
        """Let go of everything: the line is closed, or lost by that error."""

    def end_without_loop(self) -> None:
        """As `end`, after the event loop was closed."""
        if (line := self._open_line()) is not None:
            line.is_closing = True

    def follow(self, audience: Audience) -> None:
        """Name the session that is fed."""
        self.audience = audience

    def announce(self) -> None:
        """Send the descriptor of the stream."""
        began = self.stream.began
        self.baudrate: int = began.baudrate
        announced = Descriptor(began.mode.response_type, began.packet_size, continuous=True)
        # Shown, too: recordings count what was received.
        self._loop.call_soon(self._send, encode_descriptor(announced))

    def _send(self, descriptor: bytes) -> None:
        if self.is_open:
            self.data_received(descriptor)


class _FedLine(Line):
    """What the session writes and asks of the line, for a `FedPort`."""

    def __init__(self, port: FedPort) -> None:
        self._port = port

    def write(self, data: bytes) -> None:
        if data == PLAY:
            self._port.announce()

    def set_polling(self, schedule: Schedule | None) -> None:
        self._port.want(schedule is not None)

    def close(self) -> None:
        self._port.end()

    def write_without_loop(self, data: bytes) -> None:
        """Nobody takes it."""

    def close_without_loop(self) -> None:
        self._port.end_without_loop()
