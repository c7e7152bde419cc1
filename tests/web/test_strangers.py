"""Strangers at the live page: on sockets of their own, since no client program would do what they do."""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import socket
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager, suppress

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from lidario.web import door
from lidario.web import server as module
from lidario.web.server import LiveServer
from tests.support import children
from tests.support.children import ROOT
from tests.support.loop import until
from tests.web.test_server import BOUND, get, publish, serving, until_viewers, viewer

MOST_BYTES = 16 << 20
"""Far more than the system keeps of a connection on both sides."""


def frame(opcode: int, contents: bytes, *, last: bool = True) -> bytes:
    """A frame as a client sends it."""
    return bytes((opcode | (0x80 if last else 0), 0x80 | len(contents))) + bytes(4) + contents


@asynccontextmanager
async def stranger(server: LiveServer) -> AsyncIterator[socket.socket]:
    """A viewer that is nothing but a socket; its buffers are small."""
    loop = asyncio.get_running_loop()
    with socket.socket() as opened:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 32768)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 32768)
        opened.setblocking(False)
        await loop.sock_connect(opened, ("127.0.0.1", server.port))
        host = f"localhost:{server.port}"
        lines = (
            "GET /live HTTP/1.1", f"Host: {host}", f"Origin: http://{host}", "Upgrade: websocket",
            "Connection: Upgrade", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: " + "A" * 22 + "==",
        )  # fmt: skip
        await loop.sock_sendall(opened, "".join(f"{line}\r\n" for line in (*lines, "")).encode())
        await until_viewers(server, 1)
        yield opened


async def sent_until_nothing_goes(opened: socket.socket, data: bytes) -> int | None:
    """Send it again and again; how many bytes went until no more did, or None where the server closed."""
    sent = idle = 0
    while sent < MOST_BYTES and idle < 300:
        try:
            sent += opened.send(data[sent % len(data) :])
            idle = 0
        except BlockingIOError:
            idle += 1
            await asyncio.sleep(0.001)
        except ConnectionError:
            return None
        await asyncio.sleep(0)
    return sent


ENDLESS = {
    "pings": frame(9, b"x" * 60),
    "empty pings": frame(9, b""),
    "pongs": frame(10, b"x" * 60),
    "a message in parts without an end": frame(0, b"", last=False),
}


@pytest.mark.parametrize("name", ENDLESS)
async def test_every_frame_counts_as_a_message(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "STATE_S", 3600.0)
    async with serving() as (server, _), stranger(server) as opened:
        if not ENDLESS[name][0] & 0x0F:
            opened.send(frame(1, b"", last=False))
        assert await sent_until_nothing_goes(opened, ENDLESS[name] * 200) is None
        await until_viewers(server, 0)


@pytest.mark.long
async def test_pings_are_not_read_while_their_pongs_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many a viewer might send: what it does not read is not kept for it."""
    monkeypatch.setattr(module, "MOST_MESSAGES", 1 << 40)
    async with serving() as (server, feeds), stranger(server) as opened:
        sent = await sent_until_nothing_goes(opened, ENDLESS["pings"] * 200)
        assert sent is not None
        assert sent < MOST_BYTES
        # The others see nothing of it.
        async with viewer(server) as other:
            await until_viewers(server, 2)
            publish(server, feeds[0], 3)
            while isinstance(await asyncio.wait_for(other.recv(), BOUND), str):
                pass
        # And once it reads, what it sends is read again.
        opened.settimeout(0)
        async with asyncio.timeout(BOUND):
            while True:
                with suppress(BlockingIOError):
                    opened.recv(1 << 20)
                try:
                    if opened.send(ENDLESS["pings"]):
                        break
                except BlockingIOError:
                    await asyncio.sleep(0.001)


def still_open(strangers: list[socket.socket]) -> int:
    """How many of them the server has not closed."""
    count = 0
    for each in strangers:
        each.setblocking(False)
        try:
            count += bool(each.recv(4096))
        except BlockingIOError:
            count += 1
        except ConnectionError:
            pass
    return count


@pytest.mark.long
@pytest.mark.parametrize(("addresses", "most"), [(1, door.MOST_WAITING_EACH), (40, door.MOST_WAITING)])
@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nHost: localhost\r\nA: "])
async def test_who_says_nothing_takes_only_so_many_places(
    addresses: int, most: int, said: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    async with serving() as (server, _):
        with ExitStack() as opened, caplog.at_level(logging.INFO, "lidario.web"):
            strangers = []
            for number in range(200):
                each = opened.enter_context(socket.socket())
                if addresses > 1:
                    each.bind((f"127.0.0.{2 + number % addresses}", 0))
                each.connect(("127.0.0.1", server.port))
                each.send(said)
                strangers.append(each)
                await asyncio.sleep(0)
            await until(lambda: still_open(strangers) <= most)
            assert (await get(server, "/", f"localhost:{server.port}"))[0].startswith(b"HTTP/1.1 200 ")
            async with viewer(server):
                await until_viewers(server, 1)
        (record,) = caplog.records
        assert record.levelno == logging.WARNING
        assert "too many connections that ask for nothing" in record.getMessage()


async def test_a_request_has_a_longest_length() -> None:
    async with serving() as (server, _):
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        with suppress(ConnectionError):
            writer.write(b"GET / HTTP/1.1\r\n")
            for _ in range(100):
                writer.write(b"a: " + b"b" * 1000 + b"\r\n")
                await writer.drain()
            assert await asyncio.wait_for(reader.read(), BOUND) == b""
        writer.close()
        # With the cookies of other servers on this machine it is still answered.
        host = f"localhost:{server.port}\r\nCookie: " + "c" * 4000
        assert (await get(server, "/", host))[0].startswith(b"HTTP/1.1 200 ")


async def test_so_many_viewers_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even where all come at once."""
    monkeypatch.setattr(module, "MOST_VIEWERS", 3)
    async with serving() as (server, _):

        async def watch() -> int:
            with suppress(ConnectionClosed, InvalidStatus, ConnectionError):
                async with viewer(server) as connection:
                    async for _ in connection:
                        most.append(server.viewers)
            return 0

        most: list[int] = []
        watching = [asyncio.create_task(watch()) for _ in range(8)]
        await until_viewers(server, 3)
        await until(lambda: sum(task.done() for task in watching) >= 5)
        assert max(most) == server.viewers == 3
        with pytest.raises(InvalidStatus) as caught:
            await viewer(server)
        assert caught.value.response.status_code == 503
        for task in watching:
            task.cancel()
        await asyncio.gather(*watching, return_exceptions=True)


async def test_where_even_the_spare_descriptor_is_gone_it_is_not_tried_again_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Another thread may open a file just then. asyncio waits for a second where it is told the cause."""

    def none_left(*_: object) -> int:
        raise OSError(errno.EMFILE, "too many open files")

    with door.Listening(door.Door(), "127.0.0.1", 0) as listening:
        with monkeypatch.context() as patch:
            patch.setattr("os.open", none_left)
            patch.setattr(socket.socket, "accept", none_left)
            told = []
            for _ in range(2):
                with pytest.raises(OSError) as caught:  # noqa: PT011
                    listening.accept()
                told.append(caught.value.errno)
            assert told == [None, errno.EMFILE]  # by the spare one; then as asyncio must hear it
        listening.setblocking(False)
        listening.listen()
        for _ in range(2):
            with pytest.raises(BlockingIOError):
                listening.accept()  # nobody has connected
            with monkeypatch.context() as patch:
                patch.setattr(socket.socket, "accept", none_left)
                with pytest.raises(BlockingIOError):
                    listening.accept()  # there is a spare one again


FULL = """
import asyncio, logging, os, sys, time
import resource
from lidario.web.feed import Feed
from lidario.web.server import LiveServer

logging.basicConfig(format="%(name)s %(message)s")

async def main():
    async with LiveServer([Feed("lidar")], host="127.0.0.1", port=0) as server:
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
        kept = []
        try:
            while True:
                kept.append(os.open(os.devnull, os.O_RDONLY))
        except OSError:
            for handle in kept[-3:]:
                os.close(handle)
        print(server.port, flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)
        for handle in kept[:-3]:
            os.close(handle)
        print(time.process_time(), flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)

began = time.process_time()
asyncio.run(main())
"""


@pytest.mark.long
def test_without_descriptors_there_is_one_line_and_no_waiting() -> None:
    """Those that cannot be served are closed, and when there are descriptors again all is well."""
    process = subprocess.Popen(
        [sys.executable, "-c", FULL], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdin is not None
        assert process.stdout is not None
        port = int(process.stdout.readline())
        with ExitStack() as opened:
            address = ("127.0.0.1", port)
            strangers = [opened.enter_context(socket.create_connection(address, BOUND)) for _ in range(60)]
            children.until(lambda: still_open(strangers) <= 10)
        process.stdin.write("\n")
        process.stdin.flush()
        assert float(process.stdout.readline()) < BOUND
        with socket.create_connection(("127.0.0.1", port), BOUND) as each:
            each.send(f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
            assert each.recv(15).startswith(b"HTTP/1.1 200")
        _, said = process.communicate("\n", BOUND)
        assert len(said.splitlines()) == 1, said
        assert "no descriptors left" in said
    finally:
        process.kill()
        process.communicate()
