"""A line over TCP: both event loops, impossible addresses, peers that take nothing."""

import asyncio
import gc
import os
import socket
import struct
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from lidario import ConnectFailed, open_lidar
from lidario.port.port import Port
from lidario.port.sockets import open_tcp
from tests.port.test_thread import block_until_read, read_one_by_one, threads
from tests.support.loop import driven, now, until
from tests.support.ports import PATIENCE_S, Sink, arrived, on_both_loops
from tests.support.refused import refused


@asynccontextmanager
async def connected() -> AsyncIterator[tuple[Port, Sink, socket.socket]]:
    """A port that is connected, what it brings, and its peer."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port, sink = await open_tcp("tcp://x", *server.getsockname()), Sink()
        port.attach(sink)
        peer, _ = server.accept()
        with peer:
            peer.settimeout(PATIENCE_S)
            yield port, sink, peer


@on_both_loops
async def test_bytes_both_ways_at_once() -> None:
    async with connected() as (port, sink, peer):
        # Reaches the system before `write` returns: nothing else runs between these two lines.
        port.write(b"request")
        assert peer.recv(100) == b"request"
        peer.sendall(b"response")
        await sink.until(8)
        assert bytes(sink.data) == b"response"
        port.poll()
        port.write(b"the last")
        await port.close()
        assert peer.recv(100) == b"the last"
        assert peer.recv(100) == b""
        assert sink.lost == [None]


@on_both_loops
async def test_what_two_seconds_bring_to_a_blocked_loop_came_together() -> None:
    """Of what the system does not take, the peer sends the rest when the first part was read, and dated."""
    async with connected() as (_, sink, peer):
        for _ in range(70):  # nothing is awaited: the loop is blocked
            peer.sendall(bytes(2000))
        assert arrived(peer)
        await sink.until(140_000)
        assert [len(each) for each in sink.chunks] == [140_000]


@on_both_loops
async def test_each_delivery_has_its_own_time_while_the_loop_is_blocked() -> None:
    async with connected() as (port, sink, peer):
        read_one_by_one(port, sink, peer.sendall)
        # What is held when the connection ends comes before its end.
        peer.sendall(b"held")
        block_until_read(4)
        peer.close()
        assert await sink.until_lost() is not None
        assert sink.data == b"\0\1\2\3\4held"
    assert threads() == []


@pytest.mark.parametrize("size", [8_000_000, 1_000_000], ids=["more than the system takes", "all is taken"])
@on_both_loops
async def test_what_the_peer_does_not_take_is_written_later_and_before_the_end(
    size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Closed before all has arrived, it would keep the rest back: what the device sends is answered by a reset.

    Then the system forgets what it had taken: behind an outage of the network, a STOP.
    """
    monkeypatch.setattr("lidario.port.port.CLOSE_TIMEOUT_S", PATIENCE_S)  # a busy machine reads it late
    async with connected() as (port, _, peer):
        sent = os.urandom(size)
        port.write(sent)
        port.write(b"the last")
        closing = asyncio.ensure_future(port.close())
        await asyncio.sleep(0.05)
        peer.sendall(b"scan")
        loop, got = asyncio.get_running_loop(), bytearray()
        while len(got) < len(sent) + 8:
            got += await loop.run_in_executor(None, peer.recv, 1 << 20)
        assert got == sent + b"the last"
        await closing


@pytest.mark.parametrize(
    ("resets", "says"),
    # A network has no plug, and a bridge may take one connection only.
    [
        (False, ("the other end closed it. ", "another program")),
        (True, ("connection reset by peer. ", "switched off")),
    ],
)
@on_both_loops
async def test_a_peer_that_ends_is_noticed_and_told_in_words(resets: bool, says: tuple[str, str]) -> None:
    async with connected() as (port, sink, peer):
        if resets:
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        peer.close()
        said = str(await sink.until_lost())
        assert said.startswith(f"tcp://x is gone: {says[0]}")
        assert says[1] in said
        assert "unplugged" not in said
        port.write(b"ignored")
        await port.close()


@pytest.mark.usefixtures("windows")
async def test_where_no_loop_can_wait_for_a_socket_it_is_polled() -> None:
    async with connected() as (port, sink, peer):
        peer.sendall(b"response")
        await sink.until(8)
        peer.close()
        assert "the other end closed it" in str(await sink.until_lost())
        await port.close()


@on_both_loops
async def test_closing_is_bounded_when_the_peer_takes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.port.port.CLOSE_TIMEOUT_S", 0.1)
    async with connected() as (port, _, _):
        port.write(bytes(20_000_000))
        before = now()
        async with asyncio.timeout(PATIENCE_S):
            await port.close()
        assert now() - before > 0.09
        assert not port.is_open


@on_both_loops
async def test_abandoned_writes_the_stop_requests() -> None:
    async with connected() as (port, _, peer):
        port.abandon(b"stop")
        assert peer.recv(100) == b"stop"
        await port.wait_closed()
        assert peer.recv(100) == b""
        port.abandon(b"again")


async def test_abandoned_it_is_closed_though_the_peer_takes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.port.port.CLOSE_TIMEOUT_S", 0.05)
    async with connected() as (port, sink, _):
        port.write(bytes(20_000_000))
        port.abandon(b"stop")
        assert await sink.until_lost() is None


def test_abandoned_after_the_loop_was_closed() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        with asyncio.Runner() as runner:
            port = runner.run(open_tcp("tcp://x", *server.getsockname()))
            peer, _ = server.accept()
        with peer:
            peer.settimeout(PATIENCE_S)
            port.abandon(b"stop")
            assert peer.recv(100) == b"stop"
            assert peer.recv(100) == b""
        del port
        gc.collect()


@on_both_loops
async def test_a_refused_connection_says_what_to_do() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        host, number = server.getsockname()
    with refused("refused", r"connection refused\. Is the server running"):
        await open_lidar(f"tcp://{host}:{number}")


async def test_what_has_no_number_is_told_as_the_system_says_it(monkeypatch: pytest.MonkeyPatch) -> None:
    async def connect(*_: Any, **__: Any) -> None:
        raise OSError("could not bind to any address")

    monkeypatch.setattr(asyncio.get_running_loop(), "sock_connect", connect)
    with pytest.raises(ConnectFailed, match=r"^tcp://x: could not bind to any address$"):
        await open_tcp("tcp://x", "127.0.0.1", 1)


async def test_a_dead_bridge_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen: dict[int, int] = {}
    original = socket.socket.setsockopt

    def note(self: Any, level: int, option: int, value: int) -> None:
        chosen[option if level != socket.SOL_SOCKET else -option] = value
        original(self, level, option, value)

    monkeypatch.setattr(socket.socket, "setsockopt", note)
    async with connected() as (port, _, _):
        assert chosen[-socket.SO_KEEPALIVE] == 1
        assert chosen[socket.TCP_NODELAY] == 1
        assert chosen[socket.TCP_KEEPIDLE] + chosen[socket.TCP_KEEPINTVL] * chosen[socket.TCP_KEEPCNT] == 11
        # No probe is sent while anything that was written waits for its acknowledgement.
        assert chosen[socket.TCP_USER_TIMEOUT] == 11_000
        await port.close()


@pytest.mark.parametrize(
    ("host", "number", "says"),
    [
        ("a..b", 80, "not an address"),
        ("x" * 70 + ".example", 80, "not an address"),
        ("127.0.0.1", 70000, "not an address"),
        ("127.0.0.1\0", 80, "not an address"),
        ("no.such.host.invalid", 1, "Is the name of the host right?"),
    ],
)
@on_both_loops
async def test_what_cannot_be_connected_to_says_so(host: str, number: int, says: str) -> None:
    with refused("refused") as caught:
        await open_tcp(f"tcp://{host}:{number}", host, number)
    assert str(caught.value).startswith(f"tcp://{host}:{number}: ")
    assert says in str(caught.value)


def test_a_name_server_that_does_not_respond_does_not_hold_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, let_go, ended = threading.Event(), threading.Event(), threading.Event()

    def silent(*_: object, **__: object) -> None:
        asked.set()
        let_go.wait(PATIENCE_S)
        ended.set()
        raise socket.gaierror(socket.EAI_AGAIN, "no response")

    async def main() -> None:
        connecting = asyncio.create_task(open_tcp("tcp://x.example:1", "x.example", 1))
        await until(asked.is_set)
        connecting.cancel()
        await asyncio.wait([connecting])

    monkeypatch.setattr(socket, "getaddrinfo", silent)
    asyncio.run(main())
    assert not ended.is_set()
    let_go.set()
    assert ended.wait(PATIENCE_S)


@on_both_loops
async def test_a_host_with_several_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    known = [(socket.AF_INET, socket.SOCK_STREAM, 0, "", (f"127.0.0.{each}", 0)) for each in (2, 3, 1)]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: known)
    with socket.create_server(("127.0.0.1", 0)) as server:
        number = server.getsockname()[1]
        port = await open_tcp("tcp://x", "x.example", number)
        assert port.is_open
        await port.close()
    with pytest.raises(ConnectFailed, match=r"refused\. Is the server running"):
        await open_tcp("tcp://x", "x.example", number)


@driven
async def test_silent_addresses_leave_the_next_ones_their_share_of_5_s(monkeypatch: pytest.MonkeyPatch) -> None:
    known = [(socket.AF_INET, socket.SOCK_STREAM, 0, "", (f"127.0.0.{each}", 0)) for each in (2, 3, 1)]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: known)
    asked, began = dict[str, float](), now()

    async def connect(address: str, *_: object) -> socket.socket:
        asked[address] = now() - began
        if address != "127.0.0.1":
            await asyncio.Event().wait()
        return one

    monkeypatch.setattr("lidario.port.sockets.connect_socket", connect)
    one, other = socket.socketpair()
    with other:
        port = await open_tcp("tcp://x", "x.example", 1)
        await port.close()
    assert asked == pytest.approx({"127.0.0.2": 0.0, "127.0.0.3": 5 / 3, "127.0.0.1": 10 / 3})
