"""Serving a device over a real socket, and in memory.

The device here is a stand-in; see `tests.support.parrot`.
"""

from __future__ import annotations

import errno
import socket
import time

import pytest

from lidario.sim.faults import parse_faults
from lidario.sim.memory import MemoryLine
from lidario.sim.serve import TcpServer
from tests.support.children import until
from tests.support.parrot import BOUND, Parrot, read_exactly
from tests.support.replug import ReplugTcpServer

pytestmark = pytest.mark.usefixtures("no_thread_is_left")


def test_memory_line_wakes_up_for_what_the_faults_do() -> None:
    """An idle device sends nothing, and the line has something to tell all the same."""
    line = MemoryLine(Parrot(), parse_faults("late:1s,unplug:3s"))
    line.write(b"a", 0)
    assert line.wakeup(0) == 10_000
    assert line.read(10_000) == b""
    assert line.wakeup(10_000) == 1_000_010_000
    assert line.read(1_000_010_000) == b"A"
    assert line.wakeup(1_000_010_000) == 3_000_000_000
    assert line.unplugged(3_000_000_000)


def test_a_memory_line_dies_in_a_replug_and_a_new_one_works() -> None:
    device, faults = Parrot(), parse_faults("replug:2s")
    old = MemoryLine(device, faults)
    old.write(b"a", 0)
    assert old.read(10_000) == b"A"
    assert not old.unplugged(10_000)
    assert old.wakeup(10_000) == 2_000_000_000
    assert old.unplugged(2_000_000_000)
    new = MemoryLine(device, faults)
    assert new.unplugged(2_999_999_999)
    new.write(b"lost", 2_999_999_999)
    new.write(b"b", 3_000_000_000)
    assert new.read(4_000_000_000) == b"B"
    assert not new.unplugged(4_000_000_000)
    assert old.unplugged(4_000_000_000)


@pytest.mark.parametrize("text", ["reboot:1s", "freeze:1s", "protect:1s", "wrong-response:1%"])
def test_a_device_without_faults_of_its_own(text: str) -> None:
    with pytest.raises(ValueError, match="Parrot offers no faults"):
        MemoryLine(Parrot(), parse_faults(text))


class TestTcp:
    def test_a_second_client_is_shut_out(self) -> None:
        with TcpServer(Parrot()) as server, socket.create_connection(server.address, timeout=BOUND) as first:
            first.sendall(b"a")
            assert first.recv(1) == b"A"
            with socket.create_connection(server.address, timeout=BOUND) as second:
                assert second.recv(1) == b""
            first.sendall(b"b")
            assert first.recv(1) == b"B"

    def test_without_descriptors_it_does_not_try_as_fast_as_it_can(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Who has connected waits, and the system tells of it again and again."""
        tried: list[float] = []

        def refused(_: socket.socket) -> tuple[socket.socket, object]:
            tried.append(time.monotonic())
            raise OSError(errno.EMFILE, "too many open files")

        with TcpServer(Parrot()) as server:
            with monkeypatch.context() as patch:
                patch.setattr(socket.socket, "accept", refused)
                client = socket.create_connection(server.address, timeout=BOUND)
                until(lambda: len(tried) > 20)
            assert tried[20] - tried[0] > 20 * 0.001
            with client:
                client.sendall(b"a")
                assert client.recv(1) == b"A"

    def test_without_a_client_bytes_go_nowhere(self) -> None:
        device = Parrot()
        with TcpServer(device) as server:
            with socket.create_connection(server.address, timeout=BOUND) as client:
                client.sendall(b"#")
                assert client.recv(1) == b"\0"
            with socket.create_connection(server.address, timeout=BOUND) as client:
                data = read_exactly(client.fileno(), 600)
            assert data == bytes((data[0] + i) % 256 for i in range(600))  # in the midst of the count

    @pytest.mark.parametrize("comes_back", [False, True])
    def test_pulled_out_it_hangs_up_and_refuses(self, comes_back: bool) -> None:
        """Plugged in again, it listens at the same address."""
        with ReplugTcpServer(Parrot()) as server:
            with socket.create_connection(server.address, timeout=BOUND) as client:
                client.sendall(b"a")
                assert client.recv(1) == b"A"
                server.replug(0.3) if comes_back else server.unplug()
                assert client.recv(1) == b""
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(server.address, timeout=BOUND)
            if comes_back:
                assert server.plugged.wait(BOUND)
                with socket.create_connection(server.address, timeout=BOUND) as client:
                    client.sendall(b"b")
                    assert client.recv(1) == b"B"

    def test_a_client_that_does_not_read_loses_bytes_and_stops_nobody(self) -> None:
        class Flood(Parrot):
            def transmit(self, now: int) -> bytes:
                return bytes(1 << 20) if self.scanning else b""

        with TcpServer(Flood()) as server, socket.create_connection(server.address) as client:
            client.sendall(b"#")
            until(lambda: server.lost > 0)
