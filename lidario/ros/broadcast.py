"""What all publishers have in common: one connection to a router, a token, a status, and a router that may go away.

A publisher belongs to one open `Lidar`. It never waits for the network: a message that cannot be sent is lost, as a
scan is that nobody reads. When the router goes away that is told once, and once when it is back; zenoh declares
everything anew by itself.
"""

from __future__ import annotations

import asyncio
import logging
import platform
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Final, NoReturn, Self

from lidario.errors import LidarError, LocalProtocolError
from lidario.model import ScanMode
from lidario.network.bus import DEFAULT_ROUTER, Bus, Sender
from lidario.network.keys import Attachment, Token, status_key, token_key
from lidario.network.status import Status
from lidario.recording.about import About
from lidario.scan import Scan
from lidario.session.lidar import Lidar
from lidario.version import __version__

__all__ = ["Broadcast", "Outlet"]

_log = logging.getLogger("lidario")

STATUS_S: Final = 1.0
"""How often the status is published. ROS 2 expects diagnostics once a second."""
RATE_S: Final = 3.0
"""Time over which the rate is measured."""


class Outlet:
    """Sends numbered messages under one key.

    Attributes:
        sent: How many.
    """

    def __init__(self, sender: Sender, gid: bytes) -> None:
        self.sent: int = 0
        self._sender = sender
        self._gid = gid

    def send(self, payload: bytes) -> None:
        """Send one message; it is lost where there is no router."""
        self.sent += 1
        self._sender.put(payload, Attachment(self.sent, time.time_ns(), self._gid).to_bytes())


class Broadcast(ABC):
    """One lidar on the network; the base of `Publisher` and `Share`.

    Args:
        lidar: An open lidar.
        router: Address of the zenoh router.
        robot: Name of this robot, for the list of a fleet; None for the name of this machine.

    Attributes:
        lidar: As above.
        router: As above.
        robot: As above.
        on_change: Called when the router is lost (False) and when it is back (True); None to log it as a warning.
        scans: Scans published so far.
    """

    form: str

    def __init__(self, lidar: Lidar, router: str = DEFAULT_ROUTER, robot: str | None = None) -> None:
        self.lidar = lidar
        self.router = router
        self.robot: str = robot or platform.node() or "unknown"
        self.on_change: Callable[[bool], None] | None = None
        self.scans: int = 0
        self._bus: Bus | None = None
        self._modes: tuple[ScanMode, ...] = ()
        self._times: deque[float] = deque(maxlen=64)
        self._ticking: asyncio.Task[None] | None = None
        self._status: Outlet | None = None

    @property
    @abstractmethod
    def key(self) -> str:
        """The key of the scans."""

    @property
    def is_connected(self) -> bool:
        """Whether the router is there."""
        return self._bus is not None and self._bus.is_connected

    @property
    def rate(self) -> float:
        """Scans a second at the moment."""
        now = asyncio.get_running_loop().time()
        recent = [each for each in self._times if now - each <= RATE_S]
        return (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0

    @abstractmethod
    def publish(self, scan: Scan) -> None:
        """Publish a scan. Never waits and never raises: without a router the scan is lost."""

    async def run(self, mode: str | int | None = None) -> None:
        """Start the lidar and publish all its scans, until it is cancelled or another task stops the lidar.

        Args:
            mode: As for `Lidar.scans`.

        Raises:
            LidarError: As iterating over `Lidar.scans`.
        """
        async with self.lidar.scans(mode) as stream:
            async for scan in stream:
                self.publish(scan)

    async def start(self) -> None:
        """Connect to the router and show the lidar; ``async with`` does so. Cancelling leaves nothing open.

        Raises:
            ConnectFailed: There is no router.
            Unsupported: The package that is needed is not installed.
        """
        if self._bus is not None:
            raise LocalProtocolError("a publisher can be started once: make another one")
        with suppress(LidarError):
            self._modes = await self.lidar.get_modes()
        bus = self._bus = await Bus.open(self.router)
        bus.on_change = self._router_changed
        self._declare(bus)
        self._status = Outlet(bus.sender(status_key(self.key)), bytes(16))
        bus.respond(status_key(self.key), lambda: self.status().to_bytes(whole=True))
        info = self.lidar.info
        bus.token(token_key(Token(self.key, self.form, self.robot, info.model, info.serial)))
        self._ticking = asyncio.create_task(self._tick(), name="lidario: publish the status")

    async def close(self) -> None:
        """Take the lidar off the network; returns when the router knows, after two seconds at most.

        Harmless when done before. Cancelling ends only the waiting.
        """
        if self._ticking is not None:
            self._ticking.cancel()
        bus = self._bus
        if bus is not None:
            self._leave()
            await bus.close()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    def __enter__(self) -> NoReturn:
        raise LocalProtocolError("a publisher is entered asynchronously: write `async with`")

    def __exit__(self, *_: object) -> None:  # noqa: B027 - never reached
        """Never reached; `with` looks for it before `__enter__` can say what to write."""

    def status(self) -> Status:
        """How the lidar is, as the network is told."""
        lidar = self.lidar
        return Status(
            form=self.form,
            robot=self.robot,
            about=self._about(),
            modes=self._modes,
            mode=lidar.mode,
            rate=self.rate,
            lost="" if lidar.is_connected else "the lidar is away from its publisher",
        )

    # ------------------------------------------------------------------------------------------ for subclasses

    @abstractmethod
    def _declare(self, bus: Bus) -> None:
        """Declare what is published."""

    def _leave(self) -> None:  # noqa: B027 - most have nothing to end
        """End what `_declare` began."""

    def _each_second(self, status: Status) -> None:  # noqa: B027 - most have nothing more to tell
        """The status has been published."""

    def _about(self) -> About:
        lidar = self.lidar
        return About(lidar.info, lidar.health, source=lidar.source, baudrate=lidar.baudrate, lidario=__version__)

    def _count(self) -> None:
        self.scans += 1
        self._times.append(asyncio.get_running_loop().time())

    # ------------------------------------------------------------------------------------------ inside

    async def _tick(self) -> None:
        while True:
            status = self.status()
            if self._status is not None:
                self._status.send(status.to_bytes(whole=False))
            self._each_second(status)
            await asyncio.sleep(STATUS_S)

    def _router_changed(self, connected: bool) -> None:
        if self.on_change is not None:
            self.on_change(connected)
        elif connected:
            _log.warning("the zenoh router at %s is back", self.router)
        else:
            _log.warning("the zenoh router at %s is lost; scans are not sent until it is back", self.router)
