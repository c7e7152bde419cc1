"""The real path: pyserial-asyncio on a pseudo-terminal, and TCP; cables pulled, ports shared, loops closed."""

from __future__ import annotations

import asyncio
import gc
import os
import pty
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from lidario import ConnectFailed, DeviceLost, Lidar, open_lidar
from lidario.port.port import open_serial, open_tcp
from lidario.sim.serve import PtyServer, TcpServer
from tests.support.devices import FAMILIES, Rig, left_still, make_rig

PATIENCE_S = 20.0
ROOT = Path(__file__).parents[2]
LATENCIES = (0.0, 0.005)


class Sink:
    """Keeps what a port brings."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.chunks: list[bytes] = []
        self.lost: list[DeviceLost | None] = []
        self.more = asyncio.Event()

    def data_received(self, data: bytes, now: int) -> None:
        self.data += data
        self.chunks.append(data)
        self.more.set()

    def connection_lost(self, error: DeviceLost | None) -> None:
        self.lost.append(error)
        self.more.set()

    async def until(self, size: int) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while len(self.data) < size and not self.lost:
                self.more.clear()
                await self.more.wait()


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """The controlling end of a pseudo-terminal, and the path of the other."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    os.close(slave)
    if master >= 0:
        os.close(master)


def served(rig: Rig) -> PtyServer:
    return PtyServer(rig.device, chunk=64)


def quiet(server: PtyServer, rig: Rig) -> bool:
    with server.lock:
        return left_still(rig)


async def until_still(server: PtyServer, rig: Rig) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not quiet(server, rig):
            await asyncio.sleep(0.01)


@pytest.mark.parametrize("latency", LATENCIES)
async def test_every_byte_arrives_in_order(terminal: tuple[int, str], latency: float) -> None:
    master, path = terminal
    port, sink = await open_serial(path, 1_000_000), Sink()
    port.attach(sink)
    port.set_latency(latency)
    sent = bytes(range(256)) * 200
    for begin in range(0, len(sent), 1000):
        os.write(master, sent[begin : begin + 1000])
        await sink.until(min(begin + 1000, len(sent)))
    assert bytes(sink.data) == sent
    await port.close()
    assert sink.lost == [None]


async def test_a_write_is_out_before_it_returns(terminal: tuple[int, str]) -> None:
    master, path = terminal
    port = await open_serial(path, 115200)
    os.set_blocking(master, False)
    port.write(b"\xa5\x25")
    assert os.read(master, 16) == b"\xa5\x25"
    await port.close()
    port.write(b"too late")
    with pytest.raises(BlockingIOError):
        os.read(master, 16)


@pytest.mark.parametrize("latency", LATENCIES)
async def test_while_it_rests_bytes_gather_and_come_together(terminal: tuple[int, str], latency: float) -> None:
    master, path = terminal
    port, sink = await open_serial(path, 1_000_000), Sink()
    port.attach(sink)
    rests, lateness = [0.05, 0.05], list[float]()

    def rest(late: float) -> float:
        lateness.append(late)
        return rests.pop(0) if rests else 0.0

    port.set_latency(latency, rest)
    for piece in (b"one ", b"two ", b"three"):
        os.write(master, piece)
    time.sleep(0.1)  # noqa: ASYNC251 - a program that blocks its loop
    await sink.until(13)
    assert sink.chunks == [b"one two three"]
    assert lateness[0] == 0
    assert lateness[1] >= 0.04
    os.write(master, b"four")
    await sink.until(17)
    # The rest is over: as `latency` says, from now on.
    assert not rests
    os.write(master, b"five")
    await sink.until(21)
    assert bytes(sink.data) == b"one two threefourfive"
    await port.close()


@pytest.mark.parametrize("latency", LATENCIES)
async def test_a_pulled_cable_is_noticed(terminal: tuple[int, str], latency: float) -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    port, sink = await open_serial(os.ttyname(slave), 115200), Sink()
    os.close(slave)
    port.attach(sink)
    port.set_latency(latency)
    os.write(master, b"last words")
    await sink.until(10)
    os.close(master)
    await sink.until(1 << 30)
    (error,) = sink.lost
    assert error is not None
    assert "unplugged" in str(error)
    await port.close()


async def test_a_missing_port_says_so(tmp_path: Path) -> None:
    with pytest.raises(ConnectFailed, match="no such port") as caught:
        await open_serial(str(tmp_path / "ttyUSB9"), 115200)
    assert caught.value.reason == "missing"
    file = tmp_path / "file"
    file.write_text("not a port")
    with pytest.raises(ConnectFailed, match="not a serial port"):
        await open_serial(str(file), 115200)


async def test_a_port_is_opened_by_one_program_alone() -> None:
    rig = make_rig("rplidar")
    with served(rig) as server:
        async with open_lidar(f"serial://{server.path}?family=rplidar&baud=1000000"):
            with pytest.raises(ConnectFailed, match="busy") as caught:
                await open_lidar(server.path)
            assert caught.value.reason == "busy"
        async with open_lidar(f"serial://{server.path}?family=rplidar&baud=1000000"):
            pass


async def test_nobody_at_the_other_end_of_a_socket() -> None:
    rig = make_rig("rplidar")
    with TcpServer(rig.device) as server:
        host, number = server.address
    with pytest.raises(ConnectFailed, match=f"{host}:{number}") as caught:
        await open_lidar(f"tcp://{host}:{number}")
    assert caught.value.reason == "refused"
    with pytest.raises(ConnectFailed):
        await open_tcp("tcp://no.such.host.invalid:1", "no.such.host.invalid", 1)


@pytest.mark.parametrize("family", FAMILIES)
async def test_scans_over_tcp(family: str) -> None:
    rig = make_rig(family)
    with TcpServer(rig.device) as server:
        async with open_lidar("tcp://{}:{}".format(*server.address)) as lidar:
            async with asyncio.timeout(PATIENCE_S):
                scan = await lidar.scan()
            assert len(scan) > 1000
        async with asyncio.timeout(PATIENCE_S):
            while rig.device.scanning or rig.device.motor_on:
                await asyncio.sleep(0.01)


@pytest.mark.parametrize("family", FAMILIES)
async def test_an_unplugged_lidar_ends_the_stream_at_once(family: str) -> None:
    rig = make_rig(family)
    with served(rig) as server:
        async with open_lidar(f"serial://{server.path}?family={family}&baud=512000") as lidar:
            stream = lidar.scans()
            await anext(stream)
            server.unplug()
            # Noticed by the hang-up itself: the watchdog, which is slower, would say that no data came.
            with pytest.raises(DeviceLost, match="unplugged"):
                async with asyncio.timeout(PATIENCE_S):
                    async for _ in stream:
                        pass


def test_ctrl_c_in_the_middle_of_a_scan_stops_the_motor() -> None:
    rig = make_rig("rplidar")
    program = (
        "import asyncio, sys, lidario\n"
        "async def main():\n"
        "    async with lidario.open_lidar(sys.argv[1]) as lidar:\n"
        "        async for scan in lidar.scans():\n"
        "            print(scan.seq, flush=True)\n"
        "asyncio.run(main())\n"
    )
    with served(rig) as server:
        process = subprocess.Popen(
            [sys.executable, "-c", program, server.path],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        assert process.stdout is not None
        # On a busy machine the first scan may be dropped.
        assert process.stdout.readline().strip().isdecimal()
        process.send_signal(2)
        _, errors = process.communicate(timeout=PATIENCE_S)
        assert "KeyboardInterrupt" in errors
        asyncio.run(until_still(server, rig))


@pytest.mark.parametrize("end", ["sys.exit(3)", "raise RuntimeError('a bug of mine')", "loop.stop()"])
def test_a_program_that_ends_without_closing_still_stops_the_motor(end: str) -> None:
    rig = make_rig("rplidar")
    program = (
        "import asyncio, sys, lidario\n"
        "async def main(loop):\n"
        "    lidar = await lidario.open_lidar(sys.argv[1])\n"
        "    async for scan in lidar.scans():\n"
        f"        {end}\n"
        "loop = asyncio.new_event_loop()\n"
        "task = loop.create_task(main(loop))\n"
        "task.add_done_callback(lambda _: loop.stop())\n"
        "loop.run_forever()\n"
        "loop.close()\n"
    )
    with served(rig) as server:
        process = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", program, server.path],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            cwd=ROOT,
            check=False,
        )
        assert process.returncode == (3 if "exit" in end else 0), process.stderr
        asyncio.run(until_still(server, rig))


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_closed_loop_does_not_keep_the_motor_on() -> None:
    rig = make_rig("rplidar")
    with served(rig) as server:
        loop = asyncio.new_event_loop()
        lidar: Lidar | None = loop.run_until_complete(open_lidar(server.path)._open())
        assert lidar is not None
        stream = lidar.scans()
        loop.run_until_complete(stream.__anext__())
        loop.close()
        del stream, lidar
        gc.collect()
        asyncio.run(until_still(server, rig))


async def test_a_lidar_that_nobody_holds_any_more_is_stopped() -> None:
    rig = make_rig("rplidar")
    with served(rig) as server:
        lidar: Lidar | None = await open_lidar(server.path)
        assert lidar is not None
        await anext(lidar.scans())
        lidar = None
        gc.collect()
        for _ in range(3):
            await asyncio.sleep(0)
        await until_still(server, rig)
        async with open_lidar(server.path) as again:
            assert len(await again.scan()) > 1000


@pytest.mark.parametrize("family", FAMILIES)
async def test_opening_and_closing_leaves_nothing_behind(family: str) -> None:
    before = threading.active_count(), len(os.listdir("/dev/fd"))
    for _ in range(3):
        async with open_lidar(f"sim://{'rplidar-s2' if family == 'rplidar' else 'ydlidar-4ros'}") as lidar:
            await lidar.scan()
    assert (threading.active_count(), len(os.listdir("/dev/fd"))) == before
    assert asyncio.all_tasks() == {asyncio.current_task()}
