"""One connection to a zenoh router. The only place that knows the package ``eclipse-zenoh``.

It is always opened as a *client*. Since 2024 the routers of ROS 2 forward nothing from peer to peer, but always
from and to clients, so a peer is seen by luck of the network only (rmw_zenoh's README, and its issues 625 and 929).

zenoh calls back in threads of its own, without a queue before it: who sends too fast waits, and its messages do not
pile up here. `lidario.network.handover` hands everything to the event loop, in order; what is not taken in time is
dropped, oldest first, and counted. When the router goes away zenoh connects again by itself and declares everything
anew.
"""

import asyncio
import logging
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self, TypeVar

from lidario.errors import ConnectFailed, InvalidValue
from lidario.network.handover import ITEM_BYTES, Handover
from lidario.network.keys import Sender
from lidario.network.router import (
    OpenSession,
    check_config,
    check_router,
    put_into,
    the_package,
    why_no_router,
    words_of,
)
from lidario.port.background import run_in_thread, running_loop

if TYPE_CHECKING:
    import zenoh

T = TypeVar("T")
_log = logging.getLogger("lidario")

DEFAULT_ROUTER: Final = "tcp/localhost:7447"  # where rmw_zenohd listens, zenohd, and `lidario router`
OPEN_S: Final = 10.0
MOST_MESSAGE_BYTES: Final = 2 << 20
"""Of one message; a scan of the most samples has 1.2 million."""
LONGEST_KEY: Final = 1024
MOST_REPLY_BYTES: Final = 16 << 20
"""Of all responses to one query, and of all tokens that are listed: those of some thousand lidars."""
MOST_REPLIES: Final = 8
"""Responses that wait in zenoh until they are looked at. One may have 4 MiB."""
QUERY_BYTES: Final = 4096  # what a query that waits for its response takes, about, beside what it carries


class Sample(NamedTuple):
    """What was published under a key, and what was sent beside it: empty where nothing was."""

    key: str
    payload: bytes
    attachment: bytes


class Bus(OpenSession):
    """A client of one router; made by `Bus.open`.

    Attributes:
        router: Its address, such as ``tcp/localhost:7447``.
        is_connected: Whether the router is there.
        on_change: Called on the event loop when the router is lost (False) and when it is back (True).
        dropped: Samples that the event loop did not take in time.
    """

    def __init__(self, session: Any, router: str) -> None:
        self.router = router
        self.is_connected: bool = True
        self.on_change: Callable[[bool], None] | None = None
        self.dropped: int = 0
        self._loop = asyncio.get_running_loop()
        super().__init__(session)
        self._held = [session.info.declare_transport_events_listener(_at_once(self._transport_changed))]

    @classmethod
    async def open(cls, router: str = DEFAULT_ROUTER) -> Self:
        """Connect to a router. Cancelling ends the waiting, and closes what still opens.

        Where the environment names a file as ``ZENOH_CONFIG``, that is zenoh's configuration; only the mode, the
        router and the search for others are ours.

        Args:
            router: Its address in zenoh's notation: ``tcp/host:port``, ``tls/host:port``, ``udp/host:port``.

        Raises:
            ConnectFailed: It cannot be reached, or does not let us in (reason ``refused``), or its host is unknown
                (``missing``).
            InvalidValue: The address is none.
            Unsupported: The package is not installed.
        """
        running_loop()
        zenoh = the_package()
        check_router(router)
        try:
            config = _config(zenoh, router)
        except zenoh.ZError as error:
            file = os.environ.get("ZENOH_CONFIG")
            also = f", or ZENOH_CONFIG={file} is no configuration of zenoh" if file else ""
            raise InvalidValue(
                f"{router!r} is not the address of a router, such as tcp/localhost:7447{also}"
            ) from error
        try:
            async with asyncio.timeout(OPEN_S):
                session = await run_in_thread(lambda: zenoh.open(config), lambda session: session.close())
        except (zenoh.ZError, TimeoutError) as error:
            raise await run_in_thread(lambda: why_no_router(router)) from error
        return cls(session, router)

    @property
    def id(self) -> str:
        """The id of this session, as zenoh prints it."""
        return str(self._session.zid())

    def sender(self, key: str, gid: bytes, *, keeps_last: bool = False) -> Sender:
        """Publish under `key`. Where a router does not keep up, messages are lost: the lidar does not wait.

        With `keeps_last`, those who come later get the last message, too: transient local, in the words of ROS 2.
        """
        drop = the_package().CongestionControl.DROP
        if not keeps_last:
            publisher = self._hold(lambda: self._session.declare_publisher(key, congestion_control=drop))
            return Sender(publisher, gid)
        from zenoh import ext

        # As rmw_zenoh declares its publishers that are transient local (docs/design.md). Messages are told apart by
        # numbers: clients have no time stamps unless they are configured so.
        numbers = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None)
        publisher = self._hold(
            lambda: ext.declare_advanced_publisher(
                self._session, key, congestion_control=drop, cache=ext.CacheConfig(max_samples=1),
                sample_miss_detection=numbers, publisher_detection=True,
            )
        )  # fmt: skip
        return Sender(publisher, gid)

    def watch_readers(self, sender: Sender, changed: Callable[[bool], None]) -> None:
        """Call `changed` on the event loop when the first reader of `sender` comes, and when the last one goes."""

        def receive(status: Any) -> None:
            # In a thread of zenoh.
            self._call(changed, bool(status.matching))

        self._hold(lambda: sender.publisher.declare_matching_listener(_at_once(receive)))

    def token(self, key: str) -> None:
        """Show that we are alive: the token is there until this is closed, or its process or line has died."""
        self._hold(lambda: self._session.liveliness().declare_token(key))

    def respond(self, key: str, response: Callable[[], bytes]) -> None:
        """Respond to queries of `key` with what `response` returns; it is called on the event loop."""

        def send(query: Any) -> None:
            try:
                query.reply(key, response())
            except Exception as error:
                _log.debug("no response was sent to a query of %s: %s", key, error)
            finally:
                query.drop()

        put = self._handover(send)

        def receive(query: Any) -> None:
            # In a thread of zenoh. Ours carry nothing, but anybody may ask.
            carried = len(query.payload or b"") + len(query.attachment or b"") + len(str(query.parameters))
            put(query, QUERY_BYTES + carried)

        self._hold(lambda: self._session.declare_queryable(key, _at_once(receive)))

    def subscribe(self, key: str, take: Callable[[Sample], Iterable[None] | None]) -> Callable[[], None]:
        """Call `take` on the event loop with everything that is published under `key`; returns what ends that.

        What `take` returns is work that may take long, done in steps.
        """
        put = self._handover(take)

        def receive(sample: Any) -> None:
            # In a thread of zenoh.
            payload, attachment, name = sample.payload, sample.attachment, str(sample.key_expr)
            if len(payload) > MOST_MESSAGE_BYTES or len(name) > LONGEST_KEY:
                self.dropped += 1
                return
            beside = attachment.to_bytes() if attachment and len(attachment) <= LONGEST_KEY else b""
            put(Sample(name, payload.to_bytes(), beside), len(payload) + len(name) + len(beside))

        subscriber = self._hold(lambda: self._session.declare_subscriber(key, _at_once(receive)))

        def leave() -> None:
            if self._unclosed.alive:
                subscriber.undeclare()

        return leave

    def watch_tokens(self, key: str, changed: Callable[[str, bool], None]) -> None:
        """Call `changed` on the event loop with each token of `key`: True for those there and those that come."""
        put: Callable[[tuple[str, bool], int], None] = self._handover(lambda change: changed(*change))

        def receive(sample: Any) -> None:
            name = str(sample.key_expr)
            if len(name) <= LONGEST_KEY:
                put((name, "PUT" in str(sample.kind)), len(name))

        self._hold(lambda: self._session.liveliness().declare_subscriber(key, _at_once(receive), history=True))

    async def tokens(self, key: str, seconds: float) -> list[str]:
        """The tokens of `key` that are there. Cancelling ends the waiting."""
        replies = await self._gather(lambda replies: self._session.liveliness().get(key, replies, timeout=seconds))
        return [reply.key for reply in replies]

    async def query(self, key: str, seconds: float) -> list[Sample]:
        """Ask everybody who responds to `key`. Cancelling ends the waiting."""
        everybody = the_package().QueryTarget.ALL
        none = the_package().ConsolidationMode.NONE
        return await self._gather(
            lambda replies: self._session.get(key, replies, timeout=seconds, target=everybody, consolidation=none)
        )

    async def close(self) -> None:
        """As `OpenSession.close`."""
        self.on_change = None
        await super().close()

    def close_soon(self) -> None:
        """As `close`, without waiting, and without an event loop."""
        if self._unclosed.alive:
            self._held = []
            self._unclosed()

    def _hold(self, declare: Callable[[], Any]) -> Any:
        """What is declared to zenoh, and held until this is closed."""
        with self._told():
            held = declare()
        self._held.append(held)
        return held

    async def _gather(self, ask: Callable[[Any], Any]) -> list[Sample]:
        few = the_package().handlers.FifoChannel(MOST_REPLIES)
        with self._told():
            # The iteration blocks until the last response has come, or the time is up.
            return await run_in_thread(lambda: _collected(ask(few)))

    def _handover(self, take: Callable[[T], Iterable[None] | None]) -> Callable[[T, int], None]:
        """What hands things and their sizes over from a thread of zenoh to `take`, on the event loop."""

        def take_open(item: T) -> Iterable[None] | None:
            return take(item) if self._unclosed.alive else None

        handover = Handover(take_open, self._call)

        def put(item: T, size: int) -> None:
            self.dropped += handover.put(item, size)

        return put

    @contextmanager
    def _told(self) -> Iterator[None]:
        """No exception of zenoh leaves this module."""
        try:
            yield
        except the_package().ZError as error:
            raise ConnectFailed(
                f"the zenoh session with {self.router} failed: {words_of(error)}", reason="refused"
            ) from error

    def _transport_changed(self, event: Any) -> None:
        if "router" in str(event.transport.whatami).lower():
            self._call(self._change, "PUT" in str(event.kind))

    def _change(self, connected: bool) -> None:
        if connected != self.is_connected and self._unclosed.alive:
            self.is_connected = connected
            if self.on_change is not None:
                self.on_change(connected)

    def _call(self, callback: Callable[..., None], *values: Any) -> None:
        """From a thread of zenoh to the event loop; nowhere, when that is closed."""
        try:
            self._loop.call_soon_threadsafe(callback, *values)
        except RuntimeError:
            _log.debug("the event loop is closed, so what zenoh brings is dropped")


def _at_once(callback: Callable[[Any], None]) -> Any:
    """A callback for zenoh, in the thread that has received.

    zenoh would make a thread of Python for each one: it would keep 256 messages before that, of any size, and the
    thread would keep a program from ending that has not closed its bus.
    """
    return the_package().handlers.Callback(callback, indirect=False)


def _collected(replies: Iterable[Any]) -> list[Sample]:
    """The responses, as far as they are bounded."""
    found: list[Sample] = []
    size = 0
    for reply in replies:
        if reply.ok is not None:
            name, payload = str(reply.ok.key_expr), reply.ok.payload
            size += len(name) + len(payload) + ITEM_BYTES
            if size > MOST_REPLY_BYTES:
                _log.warning("more was responded to a query of zenoh than is taken: the rest is left out")
                break
            found.append(Sample(name, payload.to_bytes(), b""))
    return found


def _config(module: Any, router: str) -> "zenoh.Config":
    # Certificates, user names and all else that a network may need stand in a file of the user's.
    named = os.environ.get("ZENOH_CONFIG", "")
    check_config(named)
    config: zenoh.Config = module.Config.from_env() if named else module.Config()
    settings = {
        "mode": "client",
        "connect/endpoints": [router],
        # Only the router that was named: another one that happens to be on the network is not asked for.
        "scouting/multicast/enabled": False,
        # How soon it tries again when the router is gone: zenoh's own first wait is a second.
        "connect/retry": {"period_init_ms": 250, "period_max_ms": 4000, "period_increase_factor": 2},
        # If nobody has closed the bus, the program waits at its end for a router that accepts and says nothing.
        "transport/unicast/open_timeout": 5000,
        # It would put together messages of a gigabyte from their fragments.
        "transport/link/rx/max_message_size": 2 * MOST_MESSAGE_BYTES,
        # It would keep files in /dev/shm open for messages of a few kilobytes.
        "transport/shared_memory/enabled": False,
    }
    put_into(config, settings)
    return config
