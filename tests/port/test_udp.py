"""A line of datagrams: both event loops, a device that is not there, one that is pulled out."""

import asyncio
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import pytest

from lidario import ConnectFailed, open_lidar
from lidario.port.port import Port
from lidario.port.sockets import open_udp
from lidario.sim.rooms import make_world
from lidario.sim.serve import UdpServer
from tests.port.test_thread import Steady, threads
from tests.support.devices import left_still, make_rig, names
from tests.support.ports import PATIENCE_S, Sink, arrived, impatient, on_both_loops
from tests.support.refused import refused


@pytest.fixture
def peer() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        made.settimeout(PATIENCE_S)
        yield made


@asynccontextmanager
async def connected(peer: socket.socket) -> AsyncIterator[tuple[Port, Sink, tuple[str, int]]]:
    """A port whose first request the peer has read, what it brings, and where it is; closed behind the block."""
    port, sink = await open_udp("udp://x", *peer.getsockname()), Sink()
    port.attach(sink)
    # Reaches the system before `write` returns: nothing else runs between these two lines.
    port.write(b"request")
    data, client = peer.recvfrom(100)
    assert data == b"request"
    yield port, sink, client
    await port.close()


def source_of(address: tuple[str, int], options: str = "") -> str:
    return "udp://{}:{}".format(*address) + options


@on_both_loops
async def test_bytes_both_ways(peer: socket.socket) -> None:
    async with connected(peer) as (port, sink, client):
        assert (port.baudrate, port.is_open) == (0, True)
        for piece in (b"resp", b"", b"onse"):
            peer.sendto(piece, client)
        await sink.until(8)
        assert bytes(sink.data) == b"response"
        port.set_dtr(True)
        port.poll()
        port.write(b"the last")
    assert peer.recv(100) == b"the last"
    assert sink.lost == [None]
    port.write(b"ignored")


async def test_of_several_addresses_ipv4_is_taken(peer: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing tells at once that an address is the wrong one, as ``localhost`` may be that of IPv6 first."""
    stream = socket.SOCK_STREAM
    known = [(socket.AF_INET6, stream, 6, "", ("::1", 0, 0, 0)), (socket.AF_INET, stream, 6, "", ("127.0.0.1", 0))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: known)
    port = await open_udp("udp://x", "x.example", peer.getsockname()[1])
    port.write(b"request")
    assert peer.recv(100) == b"request"
    await port.close()


@on_both_loops
async def test_each_request_is_a_datagram_of_its_own(peer: socket.socket) -> None:
    """No document says that a device looks for a second request in one."""
    source = source_of(peer.getsockname(), "?family=rplidar")
    opening = asyncio.ensure_future(open_lidar(source).__aenter__())
    loop = asyncio.get_running_loop()
    first = await loop.run_in_executor(None, peer.recv, 100)
    assert first == b"\xa5\x25"
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    assert [peer.recv(100) for _ in range(2)] == [bytes.fromhex("a5a80200000f"), b"\xa5\x25"]


@on_both_loops
async def test_what_waits_behind_a_blocked_loop_came_together(peer: socket.socket) -> None:
    """Dated one by one, each datagram would seem to have come when it was its turn to be read."""
    sent = [b"%03d" % number for number in range(200)]
    async with connected(peer) as (_, sink, client):
        for each in sent:  # nothing is awaited: the loop is blocked
            peer.sendto(each, client)
        assert arrived(peer)
        await sink.until(600)
        assert sink.chunks == [b"".join(sent)]


@pytest.mark.parametrize(("name", "most", "read"), [("MOST_READS", 8, 24), ("MOST_BYTES", 9, 9)])
async def test_a_flood_is_read_in_parts(
    peer: socket.socket, name: str, most: int, read: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"lidario.port.inbox.{name}", most)
    async with connected(peer) as (_, sink, client):
        for number in range(100):
            peer.sendto(b"%03d" % number, client)
        assert arrived(peer)
        await sink.until(300)
        assert {len(each) for each in sink.chunks[:-1]} == {read}


@pytest.mark.long
@on_both_loops
async def test_what_the_system_does_not_send_is_not_the_end(peer: socket.socket) -> None:
    """As where a network card has no room; no datagram is as long as this one."""
    async with connected(peer) as (port, _, _):
        port.write(bytes(70_000))
        await asyncio.sleep(0.001)
        assert port.is_open
        port.write(b"another")
        assert peer.recvfrom(100)[0] == b"another"


@pytest.mark.long
@on_both_loops
async def test_sessions_one_behind_the_other() -> None:
    """The last client is the one that is served."""
    rig = make_rig("rplidar-s2e", world=make_world("circle"))
    with UdpServer(rig.device) as server:
        for _ in range(2):
            async with asyncio.timeout(PATIENCE_S), open_lidar(source_of(server.address)) as lidar:
                assert lidar.info.model == "RPLIDAR S2E"
                scan = await lidar.scan()
                assert len(scan) == pytest.approx(3200, abs=3)
                assert scan.ranges[scan.ranges > 0] == pytest.approx(2.0, abs=0.01)
                await lidar.get_health()
                await lidar.scan()
        assert server.lost == 0
    assert names(rig).count("express_scan") >= 4
    assert left_still(rig)


@on_both_loops
async def test_a_refusal_that_the_thread_meets_is_told(peer: socket.socket) -> None:
    """The system tells it once, to whoever reads first."""
    port, sink = await open_udp("udp://x", *peer.getsockname()), Sink()
    port.attach(sink)
    port.set_polling(Steady())
    peer.close()
    port.write(b"request")
    assert "nothing listens at this UDP port" in str(await sink.until_lost())
    await port.close()
    assert threads() == []


@on_both_loops
async def test_where_nothing_listens(peer: socket.socket) -> None:
    source = source_of(peer.getsockname())
    peer.close()
    told = r"\d: nothing listens at this UDP port\. Are address and port right\?$"
    with refused("refused", told):
        await open_lidar(source)
    # As by TCP, although the port could be opened: only a request shows that nobody is there.


@pytest.mark.long
async def test_a_host_that_is_silent(peer: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    impatient(monkeypatch)
    with refused("silent", "in its network"):
        await open_lidar(source_of(peer.getsockname()))


@pytest.mark.parametrize("address", ["nohost.invalid:8089", "127.0.0.1:0", "a..b:1"])
async def test_an_address_that_cannot_be(address: str) -> None:
    with pytest.raises(ConnectFailed):
        await open_lidar(f"udp://{address}")


async def test_abandoned_writes_the_stop_requests(peer: socket.socket) -> None:
    port = await open_udp("udp://x", *peer.getsockname())
    port.abandon(b"stop")
    assert peer.recv(100) == b"stop"
    await port.wait_closed()
    port.abandon(b"again")
    peer.setblocking(False)
    with pytest.raises(BlockingIOError):
        peer.recv(100)


@pytest.mark.long
async def test_an_ethernet_model_is_simulated_by_udp() -> None:
    async with asyncio.timeout(PATIENCE_S), open_lidar("sim://rplidar-t1") as lidar:
        assert lidar.info.model == "RPLIDAR T1M1"
        assert lidar.baudrate == 0
        assert "DenseBoost" in [mode.name for mode in await lidar.get_modes()]
