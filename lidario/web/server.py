"""The server of the live page: scans to any number of viewers, the latest wins.

A viewer confirms what it has drawn, and is sent no more than `AHEAD` scans that are not confirmed. What
comes meanwhile replaces what waits: one scan for each lidar. So a viewer that is slow, hidden, or stops reading
gets fewer scans and never old ones, and holds at most `AHEAD` of them in memory, here and in the buffers on the
way. The others do not notice. A scan is packed when the first viewer takes it, once for all.
"""

import asyncio
import base64
import hashlib
import logging
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib.resources import files
from typing import Final, Self, TypeVar, cast

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from lidario import Scan
from lidario.web.door import BACKLOG, Connection, Door, Listening, Refusal, judge
from lidario.web.feed import Feed
from lidario.web.frames import pack_scan, pack_state
from lidario.web.masks import Masks

AHEAD: Final = 2
"""One scan on its way while another is drawn."""
STATE_S: Final = 1.0
MOST_VIEWERS: Final = 32
MOST_BYTES: Final = 64
"""Longest message of a viewer: a letter and a time."""
MOST_MESSAGES: Final = 20
"""Messages a viewer may send in `STATE_S` beside its confirmations, of which there are no more than scans sent.
Pings and all other frames count too."""
CLOSE_S: Final = 1.0
_TIME: Final = re.compile(r"t\d{1,15}(\.\d{1,9})?", re.ASCII)
_PLAY: Final = re.compile(r"p(\d{1,9}(?:\.\d{1,3})?) (0\.25|0\.5|[1-9]|10)", re.ASCII)
"""Play recordings on from so many seconds, so many times as fast."""

T = TypeVar("T")
_log = logging.getLogger("lidario")
_noise = logging.getLogger("lidario.web.noise")
"""What ``websockets`` says of strangers is nothing that the user must read; `Door` tells it in one line."""
_noise.addHandler(logging.NullHandler())
_noise.propagate = False
_noise.setLevel(logging.CRITICAL + 1)


class _Viewer:
    """One browser, for which the latest scan of each lidar may wait.

    So many scans were sent and are `unconfirmed`. Where the `states` are to be sent, its own time goes with them as
    `echo`.
    """

    def __init__(self, connection: Connection, feeds: Sequence[Feed], masks: Masks) -> None:
        self.connection = connection
        self._feeds = feeds
        self._masks = masks
        self.waiting: dict[int, Scan] = {}
        self.unconfirmed: int = 0
        self.states: bool = True
        self.echo: float | None = None
        self.wake = asyncio.Event()
        self.wake.set()

    def receive(self, message: str | bytes) -> bool:
        """Take in a message; False where it is none of ours."""
        if message == "a" and self.unconfirmed:
            # A recording that is played as fast as it is read brings a thousand scans a second.
            self.unconfirmed -= 1
            self.wake.set()
            return True
        if not isinstance(message, str) or not _may_send(self.connection):
            return False
        if _TIME.fullmatch(message):
            self.echo, self.states = float(message[1:]), True
        elif asked := _PLAY.fullmatch(message):
            for feed in self._feeds:
                feed.play_from(float(asked[1]), float(asked[2]))
        elif message in ("r0", "r1"):
            for feed in self._feeds:
                if feed.keeper is not None:
                    feed.keeper.ask(on=message == "r1")
            self.states = True
        elif self._masks.receive(message):
            self.states = True
        elif message != "a":
            return False
        self.wake.set()
        return True


class LiveServer:
    """Serves the page and the scans of some feeds; an asynchronous context manager.

    Args:
        feeds: What is shown.
        host: Address to listen at.
        port: 0 for any.
        token: What everyone must know who connects; empty for none.
        config: The file of settings that viewers may write; None for none.
    """

    def __init__(
        self, feeds: Sequence[Feed], *, host: str, port: int, token: str = "", config: str | None = None
    ) -> None:
        self.url: str = ""  # the address to open, with the token where one is needed
        self.sent: int = 0  # scans sent, over all viewers
        self._feeds = list(feeds)
        self._host, self._port = host, port
        self._token = token
        self._masks = Masks(self._feeds, config)
        self._viewers: set[_Viewer] = set()
        self._door = Door()
        self._packed: dict[int, tuple[Scan, bytes | None]] = {}
        self._told: set[str] = set()
        self._server: Server
        self._ticking: asyncio.Task[None]
        self._page = _page()

    @property
    def viewers(self) -> int:
        """How many viewers are connected."""
        return len(self._viewers)

    @property
    def port(self) -> int:
        """The port it listens at."""
        return int(next(iter(self._server.sockets)).getsockname()[1])

    async def __aenter__(self) -> Self:
        """Listen.

        Raises:
            OSError: The port is taken, or not allowed.
        """
        listening = Listening(self._door, self._host, self._port)
        try:
            self._server = await serve(
                self._serve_viewer, sock=listening, backlog=BACKLOG,
                process_request=self._check_request, compression=None, max_size=MOST_BYTES, max_queue=4,
                close_timeout=CLOSE_S, server_header=None, logger=_noise,
                create_connection=cast("type[ServerConnection]", partial(Connection, self._door, _may_send)),
            )  # fmt: skip
        except BaseException:
            # Cancelled: asyncio has begun to listen, and its server is lost with the call.
            asyncio.get_running_loop().remove_reader(listening)
            listening.close()
            raise
        # Not localhost: a browser tries ::1 first, where another program may listen.
        self.url = f"http://{self._host}:{self.port}/" + (f"?token={self._token}" if self._token else "")
        self._ticking = asyncio.create_task(self._tick())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._ticking.cancel()
        self._server.close()
        # Browsers open connections in advance, and say nothing on them: closing would wait for their request.
        for connection in tuple(self._door.waiting):
            connection.transport.abort()
        await self._server.wait_closed()
        with suppress(asyncio.CancelledError):
            await self._ticking

    def publish_scan(self, feed: Feed) -> None:
        """Hand the latest scan of `feed` to all viewers; call it for each scan."""
        if feed.latest is None or not self._viewers:
            return
        number = self._feeds.index(feed)
        for viewer in self._viewers:
            viewer.waiting[number] = feed.latest
            viewer.wake.set()

    def publish_states(self, _: Feed | None = None) -> None:
        """Send the states of all lidars to all viewers; call it for each change."""
        for viewer in self._viewers:
            viewer.states = True
            viewer.wake.set()

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(STATE_S)
            for viewer in self._viewers:
                viewer.connection.messages = 0
            self.publish_states()

    def _check_request(self, _: ServerConnection, request: Request) -> Response | None:
        headers = request.headers
        verdict = judge(self._token, request.path, headers.get_all("Host"), headers.get_all("Origin"))
        if verdict == "page":
            return _response(200, "OK", self._page, "html")
        if isinstance(verdict, Refusal):
            return _response(verdict.status, "Refused", verdict.reason.encode() + b"\n")
        if len(self._viewers) >= MOST_VIEWERS:
            return _response(503, "Busy", b"too many viewers\n")
        return None

    async def _serve_viewer(self, connection: ServerConnection) -> None:
        assert isinstance(connection, Connection)
        if len(self._viewers) >= MOST_VIEWERS:
            # All had asked before one was in.
            await connection.close(1013, "too many viewers")
            return
        self._door.leave(connection)
        viewer = _Viewer(connection, self._feeds, self._masks)
        for number, feed in enumerate(self._feeds):
            if feed.latest is not None:
                viewer.waiting[number] = feed.latest
        self._viewers.add(viewer)
        sending = asyncio.create_task(self._send(viewer))
        try:
            async for message in connection:
                if not viewer.receive(message):
                    await connection.close(1008, "that is no message of the page")
                    break
        except ConnectionClosed:
            pass
        except Exception:
            _log.exception("a viewer was disconnected; please report this")
        finally:
            self._viewers.discard(viewer)
            sending.cancel()
            with suppress(asyncio.CancelledError, ConnectionClosed):
                await sending

    async def _send(self, viewer: _Viewer) -> None:
        with suppress(ConnectionClosed):
            while True:
                await viewer.wake.wait()
                viewer.wake.clear()
                if viewer.states:
                    viewer.states, echo, viewer.echo = False, viewer.echo, None
                    states = self._made("state", partial(pack_state, self._feeds, echo, self._masks.state()))
                    if states is not None:
                        await viewer.connection.send(states)
                while viewer.waiting and viewer.unconfirmed < AHEAD:
                    # In turn: the first one goes, and stands last when it is there again.
                    number = next(iter(viewer.waiting))
                    scan = viewer.waiting.pop(number)
                    packed = self._bytes_of(number, scan)
                    if packed is not None:
                        viewer.unconfirmed += 1
                        self.sent += 1
                        await viewer.connection.send(packed)

    def _bytes_of(self, number: int, scan: Scan) -> bytes | None:
        packed = self._packed.get(number)
        if packed is None or packed[0] is not scan:
            made = self._made(f"scan of {self._feeds[number].source}", lambda: pack_scan(number, scan))
            packed = self._packed[number] = scan, made
        return packed[1]

    def _made(self, what: str, make: Callable[[], T]) -> T | None:
        """What is to be sent; None where a mistake of ours raises, which must end no viewer. It is told once."""
        try:
            return make()
        except Exception:
            if what not in self._told:
                self._told.add(what)
                _log.exception("a %s could not be shown; please report this", what)
            return None


def _may_send(connection: Connection) -> bool:
    """Count one more message; False where it is one too many."""
    connection.messages += 1
    return connection.messages <= MOST_MESSAGES


def _page() -> bytes:
    """The page without what only its readers need: comments that fill a line, and the space before a line."""
    written = files("lidario.web").joinpath("page.html").read_bytes()
    return re.sub(rb"(?m)^ *//.*\n|^ +", b"", written)


def _response(status: int, phrase: str, body: bytes, kind: str = "plain") -> Response:
    script = re.search(rb"<script>(.*?)</script>", body, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script[1] if script else b"").digest()).decode()
    policy = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; connect-src 'self'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    headers = {
        "Content-Type": f"text/{kind}; charset=utf-8",
        "Content-Length": str(len(body)),
        "Content-Security-Policy": policy,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
        "Connection": "close",
    }
    return Response(status, phrase, Headers(headers), body)
