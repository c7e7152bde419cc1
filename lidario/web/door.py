"""Who gets in: how many connections are kept before anything is known of them, what each may send and ask for.

A connection counts as waiting until it has become a viewer. Of those, so many are kept for all, and fewer for one
address; the oldest one gives way to a new one. So who opens connections and says nothing takes only his own places,
and a browser, which says at once what it wants, gets in. Where the program has no descriptors left, the connection
is taken by a spare one and closed, since the system would report it again and again.

The package ``websockets`` bounds lines, headers and the time for a request. It answers each ping at once, whether
the answers are read or not, and counts no frame without contents. So what comes is taken in small steps here, all
frames count as messages, and nothing is read while nothing can be written.

A request is judged by its path, its Host, its Origin and its token alone. On the loopback interface every user of
this machine may connect. There a browser is the danger: any page that it shows may try to connect to this server.
So the Host must be a name of this machine itself (a foreign name could be pointed at it), and a WebSocket must come
from our own page. Open to a network, a random token is asked for in addition, and the Host may be any name.
"""

from __future__ import annotations

import asyncio
import errno
import hmac
import logging
import os
import socket
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, Literal, NamedTuple
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.frames import Frame, Opcode

MOST_WAITING: Final = 32
"""Connections that are no viewers; a browser has six at most, and says at once what it wants."""
MOST_WAITING_EACH: Final = 8
"""The same, of one address."""
MOST_HEAD: Final = 16 * 1024
"""Bytes of a request with its headers; browsers send some hundred, and some thousand with the cookies of others."""
BACKLOG: Final = 32
"""Connections that are accepted in one turn of the event loop."""
_STEP: Final = 1024
"""Bytes that are taken in at once: a viewer is closed before it has sent much more than it may."""
_TELL_EACH_S: Final = 60.0
_WHOLE: Final = (Opcode.TEXT, Opcode.BINARY)
_LOOPBACK: Final = ("localhost", "127.0.0.1", "::1")

_log = logging.getLogger("lidario.web")
_log.addHandler(logging.NullHandler())


class Door:
    """The connections that wait, each with its address, the oldest first."""

    def __init__(self) -> None:
        self.waiting: dict[Connection, str] = {}
        self._told_at = float("-inf")
        self._sent_away: Counter[str] = Counter()

    def enter(self, connection: Connection, address: str) -> None:
        """A connection was accepted; another one may have to go for it."""
        own = [each for each, other in self.waiting.items() if other == address]
        if len(own) >= MOST_WAITING_EACH:
            self.send_away(own[0], "too many connections that ask for nothing")
        elif len(self.waiting) >= MOST_WAITING:
            self.send_away(next(iter(self.waiting)), "too many connections that ask for nothing")
        self.waiting[connection] = address

    def leave(self, connection: Connection) -> None:
        """It became a viewer, or is closed; harmless when done before."""
        self.waiting.pop(connection, None)

    def send_away(self, connection: Connection, why: str) -> None:
        """Close it at once; the log tells of it once a minute."""
        self.leave(connection)
        connection.transport.abort()
        self.tell(why)

    def tell(self, why: str) -> None:
        """Log that a connection was closed, with all others of the last minute in one line."""
        self._sent_away[why] += 1
        now = asyncio.get_running_loop().time()
        if now - self._told_at >= _TELL_EACH_S:
            self._told_at = now
            count = sum(self._sent_away.values())
            _log.warning("the live page has closed %d connection%s: %s", count, "s" if count > 1 else "",
                         "; ".join(self._sent_away))  # fmt: skip
            self._sent_away.clear()


class Connection(ServerConnection):
    """A connection of a browser, or of a stranger, that comes in by a `door`.

    For each frame that is no whole message `may_send` is asked; where it says no, the connection is closed. So many
    `messages` and other frames were counted since this was set to 0.
    """

    def __init__(self, door: Door, may_send: Callable[[Connection], bool], *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.messages: int = 0
        self._door = door
        self._may_send = may_send
        self._head = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        peer = transport.get_extra_info("peername")
        self._door.enter(self, str(peer[0]) if peer else "")

    def connection_lost(self, exc: Exception | None) -> None:
        self._door.leave(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        for at in range(0, len(data), _STEP):
            if self.transport.is_closing():
                return
            step = data[at : at + _STEP]
            if self.request is None:
                self._head += len(step)
                if self._head > MOST_HEAD:
                    self._door.send_away(self, "a request that is too long")
                    return
            super().data_received(step)
        if self.paused:
            self.transport.pause_reading()

    def resume_writing(self) -> None:
        super().resume_writing()
        if not self.recv_messages.paused:
            self.transport.resume_reading()

    def process_event(self, event: Any) -> None:
        """As ``ServerConnection``: a request, or a frame."""
        is_message = not isinstance(event, Frame) or (event.fin and event.opcode in _WHOLE)
        if not is_message and not self._may_send(self):
            self._door.send_away(self, "a viewer sends more than the page does")
            return
        super().process_event(event)


class Listening(socket.socket):
    """The socket that browsers connect to; with port 0, at any that is free.

    Raises:
        OSError: The port is taken, or not allowed.
    """

    def __init__(self, door: Door, host: str, port: int) -> None:
        super().__init__(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
        self._door = door
        self._spare: int | None = None
        try:
            if os.name == "posix":
                # A port whose last connections are not forgotten yet can be listened at again.
                self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.bind((host, port))
            self._keep_spare()
        except BaseException:
            self.close()
            raise

    def accept(self) -> tuple[socket.socket, Any]:
        """As ``socket``; where no descriptor is left, whoever has connected is closed instead.

        Where another thread has taken the spare one, too, asyncio waits for a second and tries again.
        """
        if self._spare is None:
            self._keep_spare()
        try:
            return super().accept()
        except OSError as error:
            if self._spare is None or error.errno not in (errno.EMFILE, errno.ENFILE):
                raise
            self._let_go()
            with suppress(OSError):
                super().accept()[0].close()
            self._keep_spare()
            self._door.tell("this program has no descriptors left")
            raise BlockingIOError from error

    def close(self) -> None:
        self._let_go()
        super().close()

    def _keep_spare(self) -> None:
        with suppress(OSError):
            self._spare = os.open(os.devnull, os.O_RDONLY)

    def _let_go(self) -> None:
        spare, self._spare = self._spare, None
        if spare is not None:
            os.close(spare)


class Refusal(NamedTuple):
    """Why a request is refused: a status of HTTP, and one line for people."""

    status: int
    reason: str


def judge(token: str, path: str, hosts: list[str], origins: list[str]) -> Literal["page", "socket"] | Refusal:
    """Judge a request for a path with its query, by the values of its headers Host and Origin.

    Everyone must know the `token`; it is empty on the loopback interface.
    """
    try:
        where, query = urlsplit(path).path, parse_qs(urlsplit(path).query)
        host = urlsplit(f"//{hosts[0]}").hostname if len(hosts) == 1 else None
    except ValueError:
        return Refusal(400, "that is no address")
    if host is None:
        return Refusal(400, "exactly one Host is needed")
    if not token and host not in _LOOPBACK:
        return Refusal(403, "this server is for this machine alone: open it as http://127.0.0.1")
    if token and not hmac.compare_digest(query.get("token", [""])[0].encode(), token.encode()):
        return Refusal(403, "the token is missing or wrong: open the address that lidario printed")
    if where == "/":
        return "page"
    if where != "/live":
        return Refusal(404, "there is only one page here: /")
    if origins not in ([f"http://{hosts[0]}"], [f"https://{hosts[0]}"]):
        return Refusal(403, "only this server's own page may connect")
    return "socket"
