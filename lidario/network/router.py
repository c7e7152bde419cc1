"""The address of a zenoh router, and why nobody lets us in there.

zenoh says only that it could not connect. What that means decides what a user has to do, and whether waiting helps:
an address that cannot be right stays wrong, and a router that is not there may come.
"""

from __future__ import annotations

import re
import socket
from typing import Any, Final

from lidario.arguments import text_of
from lidario.errors import ConnectFailed, InvalidValue, Unsupported

_WITH_PORT: Final = ("tcp", "tls", "udp", "quic", "ws")
_WITHOUT: Final = ("serial", "unixsock-stream", "unixpipe", "vsock")
"""Addresses of these are zenoh's matter: a device, a file, a virtual machine."""
_CONNECTED: Final = ("tcp", "tls", "ws")
"""Those over TCP: whether somebody listens can be tried."""
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
