"""What carries the bytes of a port, and who is told of them.

A `Line` is one kind of connection: `lidario.port.serial`, `lidario.port.sockets` and `lidario.port.simulated` have
their own. A `Port` (`lidario.port.port`) holds one line and gives the session the same interface for all of them. A
`Receiver` and a `Schedule` are what the session gives to the port; a `Tap` is what a user gives to it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Protocol

from lidario.basics.model import LineErrors
from lidario.errors import DeviceLost
from lidario.port.forked import leave_nothing
from lidario.port.thread import Repeat

Tap = Callable[[str, bytes, int], None]
"""Sees every chunk: ``"in"`` or ``"out"``, the bytes, the time in nanoseconds of the event loop's clock."""


class Schedule(Protocol):
    """Says when received bytes are needed; all times are seconds of the port's clock."""

    @property
    def latency(self) -> float:
        """Seconds between two polls while bytes are needed; 0 to be woken for each delivery."""
        ...

    @property
    def buffer_s(self) -> float:
        """Seconds in which the system's buffer fills. The line is read earlier."""
        ...

    @property
    def due(self) -> float:
        """When the bytes are needed; from then on the line is polled as usual, and what was read handed over."""
        ...


class Receiver(Protocol):
    """Takes what the port receives."""

    def data_received(self, data: bytes, now: int, arrivals: Sequence[tuple[int, int]] = ()) -> None:
        """Bytes arrived.

        Args:
            data: The bytes.
            now: When the last of them was read, in nanoseconds of the event loop's clock.
            arrivals: Where `data` was collected from several reads, each earlier read: how many bytes of `data`
                had arrived by then, and when.
        """
        ...

    def connection_lost(self, error: DeviceLost | None) -> None:
        """The port is dead, or closed as asked (None). Called once."""
        ...


class Line(ABC):
    """What carries the bytes of a `Port`; it takes the place of an asyncio transport.

    It calls `Port.connection_made` first and `Port.connection_lost` last, both once.
    """

    is_closing: bool = False  # whether it is closed, or will be as soon as what is pending is written
    repeat: Repeat | None = None  # what a thread writes where the loop is late with it; None where no thread can

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Write at once what the operating system takes, the rest when it takes more. Never raises."""

    @abstractmethod
    def close(self) -> None:
        """Write what is pending, then close."""

    def abort(self) -> None:
        """Close without writing what is pending. Default: nothing ever is."""
        self.close()

    @abstractmethod
    def write_without_loop(self, data: bytes) -> None:
        """Write what the operating system takes, whether or not the event loop still exists. Never raises."""

    @abstractmethod
    def close_without_loop(self) -> None:
        """Close after the event loop was closed. Never raises."""

    def passed_on(self) -> tuple[int, bool] | None:
        """What a guard needs: a descriptor by which it can write too, and whether to give low latency back."""
        return None

    def let_go(self) -> None:
        """In a forked child: hold nothing open that is the parent's. Never raises."""
        if (passed := self.passed_on()) is not None:
            leave_nothing(passed[0])

    def set_baudrate(self, baudrate: int) -> None:  # noqa: B027 - most lines have no speed
        """Change the speed. Raises ConnectFailed where the adapter cannot do it."""

    def set_dtr(self, asserted: bool) -> None:  # noqa: B027 - most lines have no control lines
        """Put the control line DTR in a state. Never raises."""

    def set_polling(self, schedule: Schedule | None) -> None:  # noqa: B027 - only where polled
        """Be polled, where that costs less than being woken for each delivery."""

    def poll(self) -> None:  # noqa: B027 - only where polled
        """Read what is there now, and hand over everything that is held."""

    def hand_over(self) -> None:  # noqa: B027 - only where polled
        """Hand everything that is held to the port, as one piece."""

    @property
    def errors(self) -> LineErrors:
        """What the driver has counted as wrong since the line was opened; zeros where it does not."""
        return LineErrors()
