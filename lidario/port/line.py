"""What carries the bytes of a port, and who is told of them.

A `Line` is one kind of connection: `lidario.port.serial`, `lidario.port.tcp`, `lidario.port.udp` and
`lidario.port.simulated` each have their own. A `Port` (`lidario.port.port`) holds one line and gives the session
the same interface for all of them. A `Receiver` and a `Schedule` are what the session gives to the port; a `Tap` is
what a user gives to it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from lidario.errors import DeviceLost
from lidario.model import LineErrors

__all__ = ["Late", "Line", "Receiver", "Schedule", "Tap"]

Tap = Callable[[str, bytes, int], None]
"""Sees every chunk: ``"in"`` or ``"out"``, the bytes, the time in nanoseconds of the event loop's clock."""


class Schedule(Protocol):
    """Says when received bytes are needed; all times are seconds of the event loop's clock."""

    @property
    def interval(self) -> float:
        """Longest time in seconds for which the line may stay unread, so that the kernel's buffer never fills."""
        ...

    def rest(self, now: float) -> float:
        """For how many seconds the bytes are not needed; 0 to poll as usual."""
        ...

    def hold(self, now: float) -> float:
        """Until when bytes that were read need not be handed over; at most `now` to hand them over at once."""
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


@dataclass(slots=True)
class Late:
    """What was lost, or may have been, because this computer read a line too late.

    Attributes:
        overflow_bytes: Bytes that were read and dropped, because the program did not take them for too long.
        full_reads: Reads that found the system's buffer full: bytes that came since may be lost.
    """

    overflow_bytes: int = 0
    full_reads: int = 0


class Line(ABC):
    """What carries the bytes of a `Port`: an asyncio transport, or something that behaves like one.

    It calls `Port.connection_made` first and `Port.connection_lost` last, both once.
    """

    @abstractmethod
    def is_closing(self) -> bool:
        """Whether it is closed, or will be as soon as what is pending is written."""

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Write at once what the operating system takes, the rest when it takes more. Never raises."""

    @abstractmethod
    def close(self) -> None:
        """Write what is pending, then close."""

    @abstractmethod
    def abort(self) -> None:
        """Close without writing what is pending."""

    @abstractmethod
    def write_without_loop(self, data: bytes) -> None:
        """Write what the operating system takes, whether or not the event loop still exists. Never raises."""

    @abstractmethod
    def close_without_loop(self) -> None:
        """Close after the event loop was closed. Never raises."""

    def descriptor(self) -> int | None:
        """The file descriptor by which another process can write too; None where there is none."""
        return None

    @property
    def is_hurried(self) -> bool:
        """Whether low latency was set, and is to be given back."""
        return False

    def set_baudrate(self, baudrate: int) -> None:  # noqa: B027 - most lines have no speed
        """Change the speed. Raises ConnectFailed where the adapter cannot do it."""

    def set_dtr(self, asserted: bool) -> None:  # noqa: B027 - most lines have no control lines
        """Put the control line DTR in a state. Never raises."""

    def set_polling(self, latency: float, schedule: Schedule | None) -> None:  # noqa: B027 - only where polled
        """Be polled, where that costs less than being woken for each delivery."""

    def set_repeat(self, request: bytes, interval: float) -> None:  # noqa: B027 - only where a thread reads
        """Have a thread write `request` when it was not written for `interval` seconds; none ends it."""

    @property
    def repeated(self) -> int:
        """How often a thread has written a request."""
        return 0

    def poll(self) -> None:  # noqa: B027 - only where polled
        """Read what is there now, and hand over everything that is held."""

    def show_pending(self) -> None:  # noqa: B027 - only where a thread reads
        """Show the taps what was read and not shown yet, so that they see everything in the order of time."""

    @property
    def errors(self) -> LineErrors:
        """What the driver has counted as wrong since the line was opened; zeros where it does not."""
        return LineErrors()
