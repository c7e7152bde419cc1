"""Routers of zenoh: their addresses, why nobody lets us in there, and one in this process.

zenoh says only that it could not connect. What that means decides what a user has to do, and whether waiting helps:
an address that cannot be right stays wrong, and a router that is not there may come.

For machines on which no package brings a router, ``eclipse-zenoh`` is the whole engine: a session in router mode
that listens does what ``zenohd`` does without plugins. It lets everybody in who reaches it, unless a configuration
says otherwise; so it listens to this machine alone unless it is told to.
"""

import asyncio
import ctypes
import json
import logging
import os
import re
import socket
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Self

import anyio

from lidario.basics.arguments import path_of, text_of
from lidario.basics.whole_file import is_named_pipe
from lidario.errors import ConnectFailed, InvalidValue, Unsupported
from lidario.port.background import run_in_thread
from lidario.port.forked import let_go_in_children

_log = logging.getLogger("lidario")

LOOPBACK: Final = "tcp/127.0.0.1:7447"
"""Where it listens unless told otherwise; clients connect to ``tcp/localhost:7447`` by default."""
CLOSE_S: Final = 2.0  # longest time that closing may take; zenoh tells its peers, which may be unreachable

_WITH_PORT: Final = ("tcp", "tls", "udp", "quic", "ws")
_WITHOUT: Final = ("serial", "unixsock-stream", "unixpipe", "vsock")
"""Addresses of these are zenoh's matter: a device, a file, a virtual machine."""
_CONNECTED: Final = ("tcp", "tls", "ws")  # those over TCP: whether somebody listens can be tried
_PLACE: Final = re.compile(r"(\[[^\]]+\]|[^\[\]:]+):(\d{1,5})")
_IN_ITS_SOURCE: Final = re.compile(r"[\].]* at \S+\.rs:\d+\.?")
_TRY_S: Final = 2.0
_COMES_AND_GOES: Final = ".local"
"""Names of multicast DNS: they are known only while the machine is there."""


def the_package() -> Any:
    """The package that knows zenoh.

    Raises:
        Unsupported: It is not installed.
    """
    try:
        import zenoh
    except ModuleNotFoundError:
        raise Unsupported("zenoh needs eclipse-zenoh, which is not installed: pip install eclipse-zenoh") from None
    return zenoh


def check_router(router: str) -> None:
    """Whether `router` can be the address of a router, as far as its text tells.

    Raises:
        InvalidValue: It cannot; the text says what is missing.
    """
    protocol, slash, rest = text_of(router, "the address of a router").partition("/")
    if slash and protocol in _WITHOUT and rest:
        return
    wrong = f"{router[:80]!r} is not the address of a router, such as tcp/localhost:7447"
    if not slash or not rest or not router.isprintable():
        raise InvalidValue(wrong)
    if protocol not in _WITH_PORT:
        known = ", ".join(_WITH_PORT + _WITHOUT)
        raise InvalidValue(f"{wrong}: zenoh speaks {known}, not {protocol!r}")
    place = _PLACE.fullmatch(_place_of(rest))
    if place is None:
        raise InvalidValue(f"{wrong}: it needs a host and a port")
    if not 0 < int(place[2]) < 65536:
        raise InvalidValue(f"{wrong}: {place[2]} is not the number of a port")


def why_no_router(router: str) -> ConnectFailed:
    """Find out why zenoh could not connect to `router`, an address that `check_router` has accepted.

    It blocks: for two seconds, and for as long as the system needs to look up a name.

    Returns:
        The error to raise. Its reason is ``missing`` where the host is unknown, and ``refused`` where a router may
        still come or let us in later.
    """
    protocol, _, rest = router.partition("/")
    absent = ConnectFailed(
        f"no zenoh router responds at {router}. Start one: lidario router, or ros2 run rmw_zenoh_cpp rmw_zenohd",
        reason="refused",
    )
    place = _PLACE.fullmatch(_place_of(rest))
    if protocol not in _WITH_PORT or place is None:
        return absent
    host, port = place[1].strip("[]"), int(place[2])
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        if protocol in _CONNECTED:
            # Each address is tried, one behind the other.
            socket.create_connection((host, port), _TRY_S / len(found)).close()
            return ConnectFailed(_unwelcome(router, protocol), reason="refused")
    except socket.gaierror as error:
        # A name that cannot be looked up at the moment may be right: the network may not be up yet.
        comes = error.errno == socket.EAI_AGAIN or host.lower().endswith(_COMES_AND_GOES)
        text = f"{router}: {error.strerror}. Is the name of the router's host right?"
        return ConnectFailed(text, reason="refused" if comes else "missing")
    except UnicodeError:
        return ConnectFailed(f"{router}: {host[:80]!r} cannot be the name of a host", reason="missing")
    except OSError:
        return absent
    return absent


def check_config(path: str | os.PathLike[str]) -> None:
    """Raise InvalidValue where zenoh would read its configuration for ever, and nothing could end that."""
    if is_named_pipe(path):
        raise InvalidValue(f"{path} is no configuration of zenoh: it is a pipe (FIFO)")


def put_into(config: Any, settings: Mapping[str, object]) -> None:
    """Put settings into a configuration of zenoh, each by its path there. Raises ZError where one cannot be."""
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))


def words_of(error: Exception) -> str:
    """What an error of zenoh says, without the places in zenoh's own source that it names too."""
    return _IN_ITS_SOURCE.sub("", str(error))


def _place_of(rest: str) -> str:
    """Host and port, without what zenoh takes behind them."""
    return re.split(r"[?#]", rest, maxsplit=1)[0]


def _unwelcome(router: str, protocol: str) -> str:
    if protocol == "tls":
        return (
            f"{router}: somebody listens there, but the TLS connection failed. Does ZENOH_CONFIG name a file with "
            "this network's certificates, and is the router's made for that name?"
        )
    return (
        f"no zenoh router responds at {router}, although somebody listens there. Is the port right, or does it "
        "want tls/?"
    )


class OpenSession:
    """A session of zenoh and what is declared in it; an asynchronous context manager that closes it.

    A session that nobody closes is closed when the program ends. Else its threads would outlive the interpreter,
    and a message that comes then would abort the program. A forked child has none of these threads: if it closed
    the session, or dropped what is declared, it would wait for ever.
    """

    def __init__(self, session: Any) -> None:
        self._session = session
        self._held: list[Any] = []  # a reference must be kept: zenoh removes what is garbage
        self._unclosed = weakref.finalize(self, _close, session)
        let_go_in_children(self)

    def forked(self) -> None:
        """In a forked child: it is closed by now. What it holds is never dropped, not even at the child's end."""
        self._unclosed.detach()
        for each in (self._session, self._held):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(each))

    async def close(self) -> None:
        """End everything; returns when the peers know, after two seconds at most. Cancelling ends the waiting."""
        if self._unclosed.detach() is None:
            return
        self._held = []
        try:
            async with asyncio.timeout(CLOSE_S):
                await run_in_thread(self._session.close)
        except (TimeoutError, ConnectFailed, the_package().ZError) as error:
            _log.debug("a session of zenoh did not close in time or order: %r", error)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        # A scope of anyio that is cancelled would end the waiting before it has begun.
        with anyio.CancelScope(shield=True):
            await self.close()


def _close(session: Any) -> None:
    with suppress(the_package().ZError):
        session.close()


class Router(OpenSession):
    """A router; made by `Router.open`, and used as an asynchronous context manager.

    Attributes:
        addresses: Where it listens.
    """

    def __init__(self, session: Any, addresses: Sequence[str]) -> None:
        super().__init__(session)
        self.addresses: tuple[str, ...] = tuple(addresses)

    @classmethod
    async def open(cls, *addresses: str, config: str | os.PathLike[str] | None = None) -> Self:
        """Listen, and forward what comes. Cancelling ends the waiting, and closes what still opens.

        Args:
            addresses: Where, in zenoh's notation; none: where the configuration says, or `LOOPBACK`.
            config: A file of zenoh's configuration in JSON5, for TLS and access control; None for that which
                ``ZENOH_CONFIG`` names, if any. Its mode is always that of a router.

        Raises:
            ConnectFailed: It cannot listen there: another program does (reason ``busy``), or such an address is not
                this machine's (``source``).
            InvalidValue: An address is none, or the file is no configuration.
            Unsupported: The package is not installed.
        """
        zenoh = the_package()
        for address in addresses:
            check_router(address)
        path = path_of(config, "a configuration") if config is not None else None
        made = _config(zenoh, path, addresses)
        where = json.loads(made.get_json("listen/endpoints"))
        found = where.get("router", ()) if isinstance(where, dict) else where
        try:
            session = await run_in_thread(lambda: zenoh.open(made), lambda session: session.close())
        except zenoh.ZError as error:
            raise _why_not(found, words_of(error)) from error
        return cls(session, found)


def _config(zenoh: Any, path: Path | None, addresses: Sequence[str]) -> Any:
    named = path or os.environ.get("ZENOH_CONFIG")
    check_config(named or "")
    try:
        config = zenoh.Config.from_file(str(named)) if named else zenoh.Config()
    except zenoh.ZError as error:
        raise InvalidValue(f"{named} is no configuration of zenoh: {words_of(error)}") from error
    settings: dict[str, Any] = {"mode": "router"}
    if addresses or not named:
        settings["listen/endpoints"] = list(addresses) or [LOOPBACK]
    if not named:
        # Only those who name its address: it looks for no other routers.
        settings |= {
            "scouting/multicast/enabled": False,
            "scouting/delay": 1,
            "transport/shared_memory/enabled": False,
        }
    try:
        put_into(config, settings)
    except zenoh.ZError as error:
        where = ", ".join(addresses)
        raise InvalidValue(f"{where!r} is not where a router can listen, as at tcp/127.0.0.1:7447") from error
    return config


def _why_not(addresses: Sequence[str], text: str) -> ConnectFailed:
    where = ", ".join(addresses)
    if "in use" in text:
        return ConnectFailed(
            f"{where}: another program listens there already, perhaps a router: use that one, or another port, "
            "as in tcp/127.0.0.1:7448",
            reason="busy",
        )
    return ConnectFailed(f"no router can listen at {where}: {text}", reason="source")
