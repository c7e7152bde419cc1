"""Addresses of routers that cannot be right, and what is said where no router lets us in."""

from __future__ import annotations

import socket
import time

import anyio
import pytest

from lidario.errors import InvalidValue
from lidario.network.router import Router, check_router, why_no_router


@pytest.mark.parametrize(
    ("router", "words"),
    [
        ("7447", "is not the address of a router, such as tcp/localhost:7447"),
        ("localhost:7447", "is not the address of a router"),
        ("tcp/", "is not the address of a router"),
        ("tcp/a\x00b:7447", "is not the address of a router"),
        ("tpc/localhost:7447", "zenoh speaks tcp, tls, udp, .* not 'tpc'"),
        ("tcp/localhost", "it needs a host and a port"),
        ("tcp/:7447", "it needs a host and a port"),
        ("tls/localhost:x", "it needs a host and a port"),
        ("tcp/localhost:0", "0 is not the number of a port"),
        ("tcp/localhost:99999", "99999 is not the number of a port"),
    ],
)
def test_an_address_that_cannot_be_right(router: str, words: str) -> None:
    with pytest.raises(InvalidValue, match=words):
        check_router(router)


@pytest.mark.parametrize(
    "router",
    [
        "tcp/localhost:7447",
        "tcp/[::1]:7447",
        "tls/fleet.example:7447?prio=1-3#so_sndbuf=65000",
        "quic/10.0.0.1:65535",
        "unixsock-stream//run/zenoh.sock",
        "serial//dev/ttyACM0#baudrate=115200",
    ],
)
def test_an_address_that_may_be_right(router: str) -> None:
    check_router(router)


@pytest.mark.parametrize(
    ("protocol", "words"),
    [("tcp", "although somebody listens there. Is the port right"), ("tls", "the TLS connection failed")],
)
def test_somebody_else_listens(protocol: str, words: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        error = why_no_router(f"{protocol}/127.0.0.1:{server.getsockname()[1]}")
    assert error.reason == "refused"
    assert words in str(error)


@pytest.mark.parametrize("router", ["tcp/127.0.0.1:1", "udp/127.0.0.1:1", "unixsock-stream//nowhere"])
def test_nobody_listens(router: str) -> None:
    error = why_no_router(router)
    assert error.reason == "refused"
    assert str(error).startswith(f"no zenoh router responds at {router}. Start one: lidario router")


@pytest.mark.parametrize(
    ("host", "code", "reason"),
    [
        ("typo.example", socket.EAI_NONAME, "missing"),
        ("typo.example", socket.EAI_AGAIN, "refused"),  # the network is not up yet
        ("base.local", socket.EAI_NONAME, "refused"),  # known only while that machine is there
    ],
)
def test_an_unknown_host(host: str, code: int, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: object, **__: object) -> None:
        raise socket.gaierror(code, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    error = why_no_router(f"tcp/{host}:7447")
    assert error.reason == reason
    assert str(error) == f"tcp/{host}:7447: Name or service not known. Is the name of the router's host right?"


def test_addresses_that_are_silent_share_two_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    waited = list[float]()

    def silent(_: object, timeout: float) -> None:
        waited.extend([timeout] * 4)  # each address is tried for so long
        raise TimeoutError

    known = [(socket.AF_INET, socket.SOCK_STREAM, 0, "", (f"192.0.2.{each}", 7447)) for each in range(4)]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: known)
    monkeypatch.setattr(socket, "create_connection", silent)
    assert why_no_router("tcp/router.example:7447").reason == "refused"
    assert sum(waited) == 2.0


class SlowToClose:
    """A session of zenoh that takes its time to close."""

    closed = False

    def close(self) -> None:
        time.sleep(0.05)
        self.closed = True


async def test_a_scope_that_is_cancelled_leaves_no_router_behind() -> None:
    session = SlowToClose()
    with anyio.CancelScope() as scope:
        async with Router(session, ()):
            scope.cancel()
            await anyio.sleep_forever()
    assert session.closed
