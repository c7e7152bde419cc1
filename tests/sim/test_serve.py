"""Serving a device over a real pseudo-terminal, a real socket, and in memory.

The device here is a stand-in that echoes in capitals and can be told to count aloud.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from lidario.sim.device import Received
from lidario.sim.faults import parse_faults
from lidario.sim.line import TransmitQueue
from lidario.sim.serve import MemoryLine, PtyServer, TcpServer

BOUND = 20.0  # seconds: no test waits so long unless something is broken


class Parrot:
    """Echoes in capitals; after ``#`` it sends the bytes 0, 1, 2 … 255, 0 … for ever; ``!`` makes it fail."""

    baudrate = 1_000_000
    motor_on = False

    def __init__(self) -> None:
        self.log: list[Received] = []
        self.scanning = False
        self._queue = TransmitQueue(self.baudrate)
        self._next = 0

    def receive(self, data: bytes, now: int) -> None:
        if b"!" in data:
            raise ZeroDivisionError("the parrot is dead")
        if b"#" in data:
            self.scanning, self._next = True, now
        else:
            self._queue.push(data.upper(), now)

    def transmit(self, now: int) -> bytes:
        while self.scanning and self._next <= now:
            self._queue.push(bytes(range(256)), self._next, size=1, period=20_000)
            self._next += 256 * 20_000
        return self._queue.take(now)

    def wakeup(self, now: int) -> int | None:
        at = self._queue.wakeup(now)
        return self._next if at is None and self.scanning else at


@contextlib.contextmanager
def opened(path: str) -> Iterator[int]:
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        yield port
    finally:
        os.close(port)


def read_exactly(port: int, count: int) -> bytes:
    data = b""
    while len(data) < count:
        assert select.select([port], [], [], BOUND)[0], f"only {data!r} came"
        piece = os.read(port, count - len(data))
        assert piece, f"hung up after {data!r}"
        data += piece
    return data


def eventually(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + BOUND
    while not condition():
        assert time.monotonic() < deadline, "it did not come to pass"
        time.sleep(0.002)


def served() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name == "simulated device"}


@pytest.fixture(autouse=True)
def no_thread_is_left() -> Iterator[None]:
    before = served()
    yield
    assert served() == before


def test_memory_line_carries_both_ways_in_the_callers_time() -> None:
    line = MemoryLine(Parrot())
    line.write(b"abc", 0)
    assert line.wakeup(0) == 30_000
    assert line.read(19_999) == b"A"
    assert line.read(30_000) == b"BC"
    assert line.wakeup(30_000) is None
    assert not line.unplugged(10**12)


def test_memory_line_with_faults() -> None:
    line = MemoryLine(Parrot(), parse_faults("silent:1s,unplug:2s"))
    line.write(b"ab", 0)
    assert line.read(10_000) == b"A"
    assert line.read(2_000_000_000) == b""
    assert not line.unplugged(1_999_999_999)
    assert line.unplugged(2_000_000_000)


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


class TestPty:
    def test_answers_and_stays_raw(self) -> None:
        with PtyServer(Parrot()) as server, opened(server.path) as port:
            os.write(port, b"a\r\n\x03\x04\x11\x13\x7fz")
            assert read_exactly(port, 9) == b"A\r\n\x03\x04\x11\x13\x7fZ"

    def test_clients_come_and_go(self) -> None:
        with PtyServer(Parrot()) as server:
            for word in (b"one", b"two", b"three"):
                with opened(server.path) as port:
                    os.write(port, word)
                    assert read_exactly(port, len(word)) == word.upper()

    def test_streams_without_being_asked_again_at_true_pace(self) -> None:
        with PtyServer(Parrot(), chunk=64) as server, opened(server.path) as port:
            began = time.monotonic()
            os.write(port, b"#")
            data = read_exactly(port, 10_000)
            assert time.monotonic() - began >= 10_000 * 20e-6  # 50 kB/s and no faster
            assert data == (bytes(range(256)) * 40)[:10_000]
            assert server.lost == 0

    def test_what_the_terminal_cannot_take_is_lost(self) -> None:
        with PtyServer(Parrot()) as server, opened(server.path) as port:
            os.write(port, b"#")
            eventually(lambda: server.lost > 0)  # nobody reads

    def test_unplug_kills_the_port(self) -> None:
        with PtyServer(Parrot()) as server, opened(server.path) as port:
            os.write(port, b"x")
            assert read_exactly(port, 1) == b"X"
            server.unplug()
            assert server.unplugged
            assert select.select([port], [], [], BOUND)[0]
            with contextlib.suppress(OSError):
                assert os.read(port, 10) == b""
            with pytest.raises(OSError, match=r"."):
                os.write(port, b"y")

    def test_a_fault_unplugs_it(self) -> None:
        with PtyServer(Parrot(), faults=parse_faults("unplug:20ms")) as server, opened(server.path) as port:
            os.write(port, b"#")
            eventually(lambda: server.unplugged)

    def test_faults_reach_the_client(self) -> None:
        with PtyServer(Parrot(), faults=parse_faults("insert:100%")) as server, opened(server.path) as port:
            os.write(port, b"abc")
            assert read_exactly(port, 6)[1::2] == b"ABC"

    def test_what_is_held_back_comes_though_nothing_follows(self) -> None:
        faults = parse_faults("stall:990ms")
        with PtyServer(Parrot(), faults=faults) as server, opened(server.path) as port:
            sent = 0

            def held_back() -> bool:
                nonlocal sent
                sent += os.write(port, b"a")
                return faults.holding

            eventually(held_back)
            assert read_exactly(port, sent) == b"A" * sent

    def test_close_twice_and_after_unplug(self) -> None:
        server = PtyServer(Parrot())
        server.unplug()
        server.close()
        server.close()
        assert server.unplugged

    def test_a_failing_device_is_reported_by_close(self) -> None:
        server = PtyServer(Parrot())
        with opened(server.path) as port:
            os.write(port, b"!")
            eventually(lambda: server.unplugged)
        with pytest.raises(RuntimeError, match="device failed") as caught:
            server.close()
        assert isinstance(caught.value.__cause__, ZeroDivisionError)
        server.close()

    def test_replug_gives_the_port_another_name(self) -> None:
        with PtyServer(Parrot()) as server:
            first = server.path
            with opened(first) as port:
                os.write(port, b"a")
                assert read_exactly(port, 1) == b"A"
                server.replug(0.05)
                with pytest.raises(OSError, match=r"."):
                    os.write(port, b"b")
            assert server.plugged.wait(BOUND)
            assert server.path != first
            assert not server.unplugged
            with opened(server.path) as port:
                os.write(port, b"c")
                assert read_exactly(port, 1) == b"C"

    def test_replug_as_often_as_one_likes_costs_no_descriptors(self) -> None:
        with PtyServer(Parrot()) as server:
            before = len(os.listdir("/proc/self/fd"))
            names = [server.path]
            for _ in range(5):
                server.replug(0.0)
                assert server.plugged.wait(BOUND)
                names.append(server.path)
            assert all(a != b for a, b in pairwise(names))
            # The name before the last one is held.
            assert len(os.listdir("/proc/self/fd")) == before + 1

    @pytest.mark.parametrize("gap_s", [None, 0.0], ids=["unplugged", "replugged"])
    def test_the_name_of_a_port_that_is_gone_is_given_to_nobody(self, gap_s: float | None) -> None:
        """Whoever tries to open it again would write to somebody else's terminal."""
        with PtyServer(Parrot()) as server:
            gone = server.path
            if gap_s is None:
                server.unplug()
            else:
                server.replug(gap_s)
                assert server.plugged.wait(BOUND)
            assert not os.path.exists(gone)
            pairs = [os.openpty() for _ in range(3)]
            names = {os.ttyname(slave) for _, slave in pairs}
            for handle in (each for pair in pairs for each in pair):
                os.close(handle)
            assert gone not in names

    def test_a_link_leads_to_the_new_port(self, tmp_path: Path) -> None:
        link = tmp_path / "by-id"
        with PtyServer(Parrot()) as server:
            server.link(link)
            server.replug(0.3)
            assert not link.is_symlink()
            assert server.plugged.wait(BOUND)
            assert os.readlink(link) == server.path
            with opened(str(link)) as port:
                os.write(port, b"a")
                assert read_exactly(port, 1) == b"A"
        assert not link.is_symlink()

    def test_a_replug_of_a_link_that_is_taken(self, tmp_path: Path) -> None:
        (tmp_path / "by-id").touch()
        with PtyServer(Parrot()) as server, pytest.raises(FileExistsError):
            server.link(tmp_path / "by-id")
        assert (tmp_path / "by-id").exists()

    def test_a_fault_replugs_it(self) -> None:
        with PtyServer(Parrot(), faults=parse_faults("replug:50ms")) as server:
            first = server.path
            with opened(first) as port:
                os.write(port, b"#")
                eventually(lambda: not server.plugged.is_set())
            assert server.plugged.wait(BOUND)
            assert server.path != first
            with opened(server.path) as port:
                assert len(read_exactly(port, 100)) == 100

    def test_a_replug_with_an_unplug_behind_it_ends(self) -> None:
        faults = parse_faults("replug:10ms,unplug:100ms")
        with PtyServer(Parrot(), faults=faults) as server, opened(server.path) as port:
            os.write(port, b"#")
            eventually(lambda: server.unplugged)

    def test_close_while_the_cable_is_out(self) -> None:
        server = PtyServer(Parrot())
        server.replug(600.0)
        server.close()
        assert server.unplugged
        assert not server.plugged.is_set()
        with pytest.raises(ValueError, match="unplugged"):
            server.replug()
        with PtyServer(Parrot()) as other, pytest.raises(ValueError, match="negative"):
            other.replug(-1.0)

    @pytest.mark.parametrize("wrong", [{"tick": 0.0}, {"chunk": 0}])
    def test_misuse_is_refused(self, wrong: dict[str, int]) -> None:
        with pytest.raises(ValueError, match="positive"):
            PtyServer(Parrot(), **wrong)  # type: ignore[arg-type]

    def test_the_device_can_be_touched_under_the_lock(self) -> None:
        device = Parrot()
        with PtyServer(device) as server, opened(server.path) as port:
            with server.lock:
                device.receive(b"from within", time.monotonic_ns())
            assert read_exactly(port, 11) == b"FROM WITHIN"  # although the thread was asleep


class TestTcp:
    def test_answers(self) -> None:
        with TcpServer(Parrot()) as server:
            for word in (b"one", b"two"):
                with socket.create_connection(server.address, timeout=BOUND) as client:
                    client.sendall(word)
                    assert read_exactly(client.fileno(), 3) == word.upper()

    def test_a_second_client_is_shut_out(self) -> None:
        with (
            TcpServer(Parrot()) as server,
            socket.create_connection(server.address, timeout=BOUND) as first,
        ):
            first.sendall(b"a")
            assert first.recv(1) == b"A"
            with socket.create_connection(server.address, timeout=BOUND) as second:
                assert second.recv(1) == b""
            first.sendall(b"b")
            assert first.recv(1) == b"B"

    def test_without_a_client_bytes_go_nowhere(self) -> None:
        device = Parrot()
        with TcpServer(device) as server:
            with socket.create_connection(server.address, timeout=BOUND) as client:
                client.sendall(b"#")
                assert client.recv(1) == b"\0"
            with socket.create_connection(server.address, timeout=BOUND) as client:
                data = read_exactly(client.fileno(), 600)
            assert data == bytes((data[0] + i) % 256 for i in range(600))  # in the midst of the count

    def test_unplug_hangs_up_and_refuses(self) -> None:
        with TcpServer(Parrot()) as server:
            with socket.create_connection(server.address, timeout=BOUND) as client:
                client.sendall(b"a")
                assert client.recv(1) == b"A"
                server.unplug()
                assert client.recv(1) == b""
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(server.address, timeout=BOUND)

    def test_a_client_that_does_not_read_loses_bytes_and_stops_nobody(self) -> None:
        class Flood(Parrot):
            def transmit(self, now: int) -> bytes:
                return bytes(1 << 20) if self.scanning else b""

        with TcpServer(Flood()) as server, socket.create_connection(server.address) as client:
            client.sendall(b"#")
            eventually(lambda: server.lost > 0)

    def test_replug_hangs_up_and_listens_again_at_the_same_address(self) -> None:
        with TcpServer(Parrot()) as server:
            with socket.create_connection(server.address, timeout=BOUND) as client:
                client.sendall(b"a")
                assert client.recv(1) == b"A"
                server.replug(0.3)
                assert client.recv(1) == b""
                with pytest.raises(ConnectionRefusedError):
                    socket.create_connection(server.address, timeout=BOUND)
            assert server.plugged.wait(BOUND)
            with socket.create_connection(server.address, timeout=BOUND) as client:
                client.sendall(b"b")
                assert client.recv(1) == b"B"

    def test_a_port_in_use_is_an_error(self) -> None:
        with TcpServer(Parrot()) as server, pytest.raises(OSError, match=r"."):
            TcpServer(Parrot(), *server.address)
