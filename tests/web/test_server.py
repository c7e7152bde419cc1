"""The server, with viewers of every kind; no lidar is needed for it."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from functools import partial
from typing import Any

import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Origin

from lidario import Scan
from lidario.web import server as module
from lidario.web.door import Listening
from lidario.web.feed import Feed
from lidario.web.frames import pack_scan
from lidario.web.server import AHEAD, LiveServer
from tests.support.loop import until
from tests.web.test_frames import scan

BOUND = 20.0


@asynccontextmanager
async def serving(count: int = 1, token: str = "") -> AsyncIterator[tuple[LiveServer, list[Feed]]]:
    feeds = [Feed(f"lidar {number}") for number in range(count)]
    async with LiveServer(feeds, host="127.0.0.1", port=0, token=token) as server:
        yield server, feeds


def viewer(server: LiveServer, query: str = "", origin: str | None = "") -> connect:
    host = f"localhost:{server.port}"
    own = Origin(f"http://{host}" if origin == "" else origin) if origin is not None else None
    return connect(f"ws://{host}/live{query}", origin=own, compression=None, max_queue=1000, proxy=None)


def publish(server: LiveServer, feed: Feed, seq: int) -> None:
    feed.latest = scan([1.0] * 3200, [1000.0] * 3200, seq=seq)
    server.publish_scan(feed)


async def scan_of(connection: ClientConnection) -> tuple[int, int]:
    """Number of the lidar and of the next scan that comes."""
    while isinstance(message := await asyncio.wait_for(connection.recv(), BOUND), str):
        pass
    return message[1], struct.unpack_from("<I", message, 16)[0]


async def until_viewers(server: LiveServer, count: int) -> None:
    await until(lambda: server.viewers == count)


async def get(server: LiveServer, path: str, host: str) -> tuple[bytes, bytes]:
    """Status line and body."""
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    writer.write(f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
    head, _, body = (await asyncio.wait_for(reader.read(), BOUND)).partition(b"\r\n\r\n")
    writer.close()
    await writer.wait_closed()
    return head, body


async def test_the_page_is_small_whole_and_fetches_nothing() -> None:
    async with serving() as (server, _):
        head, body = await get(server, "/", f"localhost:{server.port}")
    assert head.startswith(b"HTTP/1.1 200 ")
    assert b"default-src 'none'" in head
    assert body.rstrip().endswith(b"</html>")
    assert len(body) < 30_000
    assert b"http://" not in body
    assert b"https://" not in body
    assert b"innerHTML" not in body


async def test_a_new_viewer_gets_the_states_and_the_latest_scan_at_once() -> None:
    async with serving(2) as (server, feeds):
        publish(server, feeds[1], 5)
        async with viewer(server) as connection:
            state = json.loads(await asyncio.wait_for(connection.recv(), BOUND))
            assert [each["source"] for each in state["lidars"]] == ["lidar 0", "lidar 1"]
            assert await scan_of(connection) == (1, 5)


async def test_the_latest_scan_wins_and_none_is_queued() -> None:
    async with serving(2) as (server, feeds), viewer(server) as connection:
        await until_viewers(server, 1)
        for seq in range(50):
            publish(server, feeds[0], seq)
            publish(server, feeds[1], 100 + seq)
            await asyncio.sleep(0)
        got = [await scan_of(connection) for _ in range(AHEAD)]
        sent = server.sent
        assert sent == AHEAD
        # The viewer has drawn both: what it gets now is the latest of each lidar.
        await connection.send("a")
        await connection.send("a")
        got += [await scan_of(connection) for _ in range(2)]
        assert sorted(got[AHEAD:]) == [(0, 49), (1, 149)]


@pytest.mark.long
async def test_a_viewer_that_stops_reading_costs_the_others_nothing() -> None:
    async with serving() as (server, feeds), viewer(server) as reading, viewer(server):
        await until_viewers(server, 2)
        for seq in range(200):
            publish(server, feeds[0], seq)
            assert await scan_of(reading) == (0, seq)
            await reading.send("a")
        assert server.sent <= 200 + AHEAD
    assert server.viewers == 0


async def test_a_mistake_about_one_lidar_ends_no_viewer_and_is_told(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def pack(number: int, each: Scan) -> bytes:
        return pack_scan(number if each.seq != 7 else -1, each)

    monkeypatch.setattr(module, "pack_scan", pack)
    monkeypatch.setattr(module, "pack_state", lambda *_: 1 / 0)
    async with serving(2) as (server, feeds), viewer(server) as one, viewer(server) as another:
        await until_viewers(server, 2)
        for _ in range(3):
            publish(server, feeds[0], 7)
            publish(server, feeds[1], 8)
            for connection in (one, another):
                assert await scan_of(connection) == (1, 8)
                await connection.send("a")
        publish(server, feeds[0], 9)
        for connection in (one, another):
            assert await scan_of(connection) == (0, 9)
    told = sorted(record.getMessage() for record in caplog.records)
    assert told == [f"a {what} could not be shown; please report this" for what in ("scan of lidar 0", "state")]
    assert all(record.exc_info for record in caplog.records)


async def test_a_mistake_about_what_a_viewer_says_ends_that_viewer_and_is_told(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with serving() as (server, feeds), viewer(server) as one, viewer(server) as another:
        await until_viewers(server, 2)
        monkeypatch.setattr(feeds[0], "play_from", lambda *_: 1 / 0)
        await another.send("p1 1")
        await until_viewers(server, 1)
        publish(server, feeds[0], 5)
        assert await scan_of(one) == (0, 5)
    (record,) = caplog.records
    assert record.getMessage() == "a viewer was disconnected; please report this"
    assert record.exc_info


async def test_a_scan_is_packed_once_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    packed: list[int] = []

    def pack(number: int, each: Scan) -> bytes:
        packed.append(number)
        return pack_scan(number, each)

    monkeypatch.setattr(module, "pack_scan", pack)
    async with serving() as (server, feeds):
        publish(server, feeds[0], 0)
        assert packed == []  # nobody looks
        async with viewer(server) as first, viewer(server) as second, viewer(server) as third:
            for connection in (first, second, third):
                assert await scan_of(connection) == (0, 0)
            await until_viewers(server, 3)
            publish(server, feeds[0], 1)
            for connection in (first, second, third):
                assert await scan_of(connection) == (0, 1)
        assert packed == [0, 0]


async def test_a_change_of_state_is_told_and_a_time_is_sent_back() -> None:
    async with serving() as (server, feeds), viewer(server) as connection:
        await asyncio.wait_for(connection.recv(), BOUND)
        feeds[0].state, feeds[0].reason = "lost", "it is gone"
        server.publish_states(feeds[0])
        lidar = json.loads(await asyncio.wait_for(connection.recv(), BOUND))["lidars"][0]
        assert (lidar["state"], lidar["reason"]) == ("lost", "it is gone")
        await connection.send("t1700000000000.125")
        while json.loads(await asyncio.wait_for(connection.recv(), BOUND))["echo"] != 1700000000000.125:
            pass


@pytest.mark.parametrize(
    ("query", "origin"), [("", "http://evil.example"), ("", None), ("?token=wrong", ""), ("", "")]
)
async def test_strangers_are_refused(query: str, origin: str | None) -> None:
    async with serving(token="" if origin != "" else "right") as (server, _):
        with pytest.raises(InvalidStatus) as caught:
            await viewer(server, query, origin)
        assert caught.value.response.status_code == 403
        assert server.viewers == 0


async def test_the_token_gives_the_page_and_the_scans() -> None:
    async with serving(token="right") as (server, _):
        assert server.url.endswith(f":{server.port}/?token=right")
        assert (await get(server, "/?token=right", "robot.lan"))[0].startswith(b"HTTP/1.1 200 ")
        assert (await get(server, "/", "robot.lan"))[0].startswith(b"HTTP/1.1 403 ")
        async with viewer(server, "?token=right"):
            await until_viewers(server, 1)


@pytest.mark.parametrize(
    "messages", [["x"], [b"a"], ["a" * 65], ["t"], ["t1e5"], ["tNaN"], ["a"] * (module.MOST_MESSAGES + 2)]
)
async def test_what_viewers_may_say_is_bounded(
    messages: list[str | bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "STATE_S", 3600.0)
    async with serving() as (server, _), viewer(server) as connection:
        with pytest.raises(ConnectionClosed):
            for message in messages:
                await connection.send(message)
            async with asyncio.timeout(BOUND):
                while True:
                    await connection.recv()
        await until_viewers(server, 0)


@pytest.mark.parametrize("said", [b"", b"GET / HT"])
async def test_closing_does_not_wait_for_a_connection_that_says_nothing(
    said: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As long as a request may take, closing takes without an end of ours.
    monkeypatch.setattr(module, "serve", partial(serve, open_timeout=3 * BOUND))
    async with serving() as (server, _), viewer(server):
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(said)
        await until_viewers(server, 1)
        async with asyncio.timeout(BOUND):
            await server.__aexit__(None, None, None)
        assert server.viewers == 0
        writer.close()
        with suppress(ConnectionError):
            await reader.read()


async def test_cancelling_its_start_leaves_no_port_open(monkeypatch: pytest.MonkeyPatch) -> None:
    """As by Ctrl-C at that moment: asyncio begins to listen, and waits for a turn of the loop."""
    opened: list[Listening] = []

    def open_one(*where: Any) -> Listening:
        opened.append(Listening(*where))
        return opened[-1]

    monkeypatch.setattr(module, "Listening", open_one)
    starting = asyncio.create_task(LiveServer([], host="127.0.0.1", port=0).__aenter__())
    await asyncio.sleep(0)
    assert len(opened) == 1
    assert not starting.done()
    descriptor = opened[0].fileno()
    starting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await starting
    assert opened[0].fileno() == -1
    assert not asyncio.get_running_loop().remove_reader(descriptor)


async def test_no_noise_from_strangers(capfd: pytest.CaptureFixture[str]) -> None:
    async with serving() as (server, _):
        for garbage in (
            b"\x16\x03\x01\x02\x00",
            b"POST / HTTP/1.1\r\n\r\n",
            b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 200,
        ):
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            writer.write(garbage)
            writer.write_eof()
            await asyncio.wait_for(reader.read(), BOUND)
            writer.close()
    assert capfd.readouterr() == ("", "")
