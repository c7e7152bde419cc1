"""What all publishers have in common: one connection to a router that comes and goes, a token, and a status.

It never waits for the network: a message that cannot be sent is lost and counted. A router that is not there at the
start is waited for in a task: zenoh's own waiting could not be cancelled. A router that goes away later is zenoh's
matter: it connects again and declares everything anew by itself.
"""

import asyncio
import logging
import platform
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Collection
from contextlib import suppress
from functools import partial
from typing import Any, Final

from lidario.basics.arguments import finite, shown, text_of
from lidario.basics.entered import Entered
from lidario.basics.model import ScanMode
from lidario.errors import Busy, ConnectFailed, InvalidValue, LidarError, LocalProtocolError, SessionClosed
from lidario.network.bus import DEFAULT_ROUTER, Bus
from lidario.network.keys import Sender, Token, parse_token, status_key, token_key, tokens_of
from lidario.network.senders import what_is_heard
from lidario.network.status import AWAY, Status
from lidario.recording.about import About
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar
from lidario.session.streaming.stream import next_end, until_all
from lidario.session.talking.trouble import Trouble
from lidario.version import __version__

_log = logging.getLogger("lidario")

STATUS_S: Final = 1.0
"""How often the status is published. ROS 2 expects diagnostics once a second."""
HEARD_S: Final = 5.0  # how long the router has to pass something on
RATE_S: Final = 3.0  # time over which the rate is measured
FIRST_AGAIN_S: Final = 0.25
"""The first wait between attempts to reach a router; each is twice the one before. One costs 0.3 ms of a core."""
LAST_AGAIN_S: Final = 4.0
"""The longest of these waits."""


class Broadcast(Entered):
    """One lidar on the network; the base of `Publisher` and `Share`, which tell the arguments."""

    form: str
    key: str
    """The key of the scans on the network."""
    _instead = "a publisher is entered asynchronously: write `async with`"

    def __init__(self, lidar: Lidar, router: str = DEFAULT_ROUTER, robot: str | None = None) -> None:
        self.lidar = lidar
        self._sessions: tuple[Lidar, ...] = (lidar,)
        self.router = router
        named = "" if robot is None else text_of(robot, "the name of a robot")
        self.robot: str = named or platform.node() or "unknown"
        # Called when the router is not there at the start or is lost (False), and when it comes (True); None to log
        # `news` as a warning.
        self.on_change: Callable[[bool], None] | None = None
        self.news: str = ""  # what has happened last to the router, as a sentence; empty before anything has
        self.scans: int = 0  # scans published so far
        self.unsent: int = 0  # scans that were not sent, because there was no router
        self._closed = False
        self._is_run = False
        self._bus: Bus | None = None
        self._connecting: asyncio.Task[None] | None = None
        self._modes: tuple[ScanMode, ...] = ()
        self._told_mode: ScanMode | None = None
        self._times: deque[float] = deque(maxlen=64)
        self._ticking: asyncio.Task[None] | None = None
        self._status: Sender | None = None
        self._trouble = Trouble()
        self._read = set[Sender]()
        self._readers = asyncio.Event()

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
        """Publish a scan. Never waits: without a router the scan is lost, and counted."""

    @property
    def is_read(self) -> bool:
        """Whether anybody reads the scans, as far as the router tells; False without a router."""
        return self._readers.is_set() and self.is_connected

    async def run(self, mode: str | int | None = None, *, idle_stop: float | None = None) -> None:
        """Start the lidar and publish all its scans, until it is cancelled or another task stops the lidar.

        Args:
            mode: As for `Lidar.scans`.
            idle_stop: Seconds without a reader on the network, after which this stops reading the lidar, until a
                reader comes. Laser and motor rest then, unless another task reads the lidar. None for never.

        Raises:
            Busy: Another task runs this publisher: each scan would be sent twice.
            InvalidValue: `idle_stop` is not above 0.
            LidarError: As iterating over `Lidar.scans`.
        """
        if idle_stop is not None and not finite(idle_stop, "idle_stop") > 0:
            raise InvalidValue(f"idle_stop is a number of seconds above 0, not {shown(idle_stop)}")
        if self._is_run:
            raise Busy("two tasks run one publisher: give each its own")
        self._is_run = True
        try:
            while True:
                async with self._stream(mode) as stream:
                    if await self._publish_all(stream, idle_stop):
                        return
                    # Before it is left: another task may stop the lidar while that is awaited.
                    ends = [next_end(lidar.scans()) for lidar in self._sessions]
                _log.info("%s has no reader: its lidar rests until one comes", self.key)
                if not await self._until_read(ends):
                    return
        finally:
            self._is_run = False

    async def _until_read(self, ends: Collection[asyncio.Future[None]]) -> bool:
        """True when a reader comes; False when another task has stopped all lidars."""
        reader, stopped = map(asyncio.ensure_future, (self._readers.wait(), until_all(ends)))
        try:
            await asyncio.wait({reader, stopped}, return_when=asyncio.FIRST_COMPLETED)
            # The error that has ended a session is raised here.
            return not stopped.done() or stopped.result() is not None
        finally:
            reader.cancel()
            stopped.cancel()

    async def _publish_all(self, stream: Any, idle_s: float | None) -> bool:
        """Publish until the stream ends: True. False after so many seconds without a reader."""
        loop = asyncio.get_running_loop()
        last_read = loop.time()
        async for scan in stream:
            self.publish(scan)
            if idle_s is not None:
                if self.is_read:
                    last_read = loop.time()
                elif loop.time() - last_read >= idle_s:
                    return False
        return True

    async def start(self) -> None:
        """Show the lidar on the network; ``async with`` does so. Cancelling leaves nothing open.

        It returns when the router is there, or when the first attempt to reach it has failed, twelve seconds at
        most. Then it is told that there is no router (`on_change`), and the router is waited for in a task until
        `close`: scans that are published meanwhile are not sent.

        Raises:
            ConnectFailed: The host of the router is unknown (reason ``missing``).
            InvalidValue: `router` is not an address.
            SessionClosed: Another task has closed it meanwhile, or started it.
            Unsupported: The package that is needed is not installed.
        """
        if self._bus is not None or self._connecting is not None:
            raise LocalProtocolError("a publisher can be started once: make another one")
        with suppress(LidarError):
            self._modes = await self.lidar.get_modes()
        try:
            await self._connect()
        except ConnectFailed as error:
            if error.reason != "refused":
                raise
            self._check_alone()
            self._tell(False, f"{error}\nScans are not sent until it is there.")
            self._connecting = asyncio.create_task(self._connect_later(), name="lidario: wait for the router")

    async def close(self) -> None:
        """Take the lidar off the network; returns when the router knows, after two seconds at most.

        Harmless when done before. Cancelling ends only the waiting.
        """
        self._closed = True
        connecting, bus = self._connecting, self._bus
        if connecting is not None:
            connecting.cancel()
        if self._ticking is not None:
            self._ticking.cancel()
        if bus is not None:
            self._leave()
            await bus.close()
        elif connecting is not None:
            with suppress(RuntimeError):  # no loop runs: this is a forked child, and the task is its parent's
                await asyncio.wait([connecting])

    async def is_passed_on(self) -> bool:
        """Whether the router passes on what is published here: as soon as that is seen, or after five seconds.

        zenoh tells no publisher that access rules deny what it sends. So a second client, with the same
        configuration, listens to the scans; where none is sent meanwhile, to the status, which is sent each second.
        False, too, where the rules do not let this program hear them, and where there is no router. Cancelling
        leaves nothing open.
        """
        if self._status is None or not self.is_connected:
            return False
        before, keys, heard = self.scans, (self.key, status_key(self.key)), set[str]()
        with suppress(ConnectFailed):
            heard = await what_is_heard(self.router, keys, self._status.gid, HEARD_S)
        return self.key in heard or (self.scans == before and bool(heard))

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
            lost="" if lidar.is_connected else AWAY,
            sender=self._status.gid.hex() if self._status is not None else "",
        )

    # ------------------------------------------------------------------------------------------ for subclasses

    def _stream(self, mode: str | int | None) -> Any:
        """What is published, as a new stream."""
        return self.lidar.scans(mode)

    @abstractmethod
    def _declare(self, bus: Bus) -> bytes:
        """Declare what is published; returns what tells this publisher from others under its key."""

    def _leave(self) -> None:
        """End what `_declare` began."""

    def _watch_readers(self, bus: Bus, sender: Sender) -> None:
        """Know from now on whether anybody reads what `sender` sends, too."""

        def changed(is_read: bool) -> None:
            (self._read.add if is_read else self._read.discard)(sender)
            (self._readers.set if self._read else self._readers.clear)()

        bus.watch_readers(sender, changed)

    def _each_second(self, status: Status) -> None:
        """The status has been published."""

    def _about(self) -> About:
        lidar = self.lidar
        return About(lidar.info, lidar.health, source=lidar.source, baudrate=lidar.baudrate, lidario=__version__)

    def _count(self, sent: bool) -> None:
        """A scan was sent; or was not, for want of a router."""
        if sent and self.is_connected:
            self.scans += 1
        else:
            self.unsent += 1
        self._times.append(asyncio.get_running_loop().time())
        if self.lidar.mode != self._told_mode:
            # Readers are told at once, not up to a second behind its first scan.
            self._send_status()

    async def _connect(self) -> None:
        """Connect to the router and declare what is published."""
        bus = await Bus.open(self.router)
        try:
            self._check_alone()
        except SessionClosed:
            bus.close_soon()
            raise
        # No await from here to the end, so that cancelling comes before all of it or after.
        try:
            gid = self._declare(bus)
            self._status = bus.sender(status_key(self.key), gid)
            bus.respond(status_key(self.key), lambda: self.status().to_bytes(whole=True))
            info = self.lidar.info
            token = token_key(Token(self.key, self.form, self.robot, info.model, info.serial))
            bus.token(token)
            bus.watch_tokens(tokens_of(self.key), partial(self._token_changed, token))
        except BaseException:
            self._leave()
            bus.close_soon()
            raise
        self._bus = bus
        bus.on_change = self._router_changed
        self._ticking = asyncio.create_task(self._tick(), name="lidario: publish the status")

    def _check_alone(self) -> None:
        if self._closed or self._bus is not None or self._connecting not in (None, asyncio.current_task()):
            raise SessionClosed("another task has closed the publisher meanwhile, or started it")

    async def _connect_later(self) -> None:
        """Try until the router is there."""
        wait_s = FIRST_AGAIN_S
        while True:
            await asyncio.sleep(wait_s)
            wait_s = min(2 * wait_s, LAST_AGAIN_S)
            try:
                await self._connect()
            except LidarError as error:
                # Whatever it is, a file of certificates that is being replaced too, it may be over next time.
                _log.debug("%s", error)
            else:
                self._tell(True, f"the zenoh router at {self.router} is there")
                return

    async def _tick(self) -> None:
        while True:
            self._each_second(self._send_status())
            await asyncio.sleep(STATUS_S)

    def _send_status(self) -> Status:
        status = self.status()
        self._told_mode = status.mode
        if self._status is not None:
            self._status.send(status.to_bytes(whole=False))
        return status

    def _token_changed(self, own: str, token: str, alive: bool) -> None:
        """Tell of another lidar under the same key: readers could not tell the two apart."""
        other = parse_token(token)
        if alive and token != own and other is not None:
            text = "%s %s of %s is published under %s, too: give each lidar a key of its own"
            self._trouble.tell(text, other.model, other.serial, other.robot, self.key)

    def _router_changed(self, connected: bool) -> None:
        if not connected:
            self._read.clear()
            self._readers.clear()
        what = "is back" if connected else "is lost; scans are not sent until it is back"
        self._tell(connected, f"the zenoh router at {self.router} {what}")

    def _tell(self, connected: bool, news: str) -> None:
        self.news = news
        if self.on_change is not None:
            self.on_change(connected)
        else:
            _log.warning("%s", ". ".join(news.splitlines()))
