"""The thread that reads ports while the loop is busy: when it reads, when it ends, and that all ports share it."""

from __future__ import annotations

import asyncio
import gc
import os
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest

from lidario.port.inbox import Inbox
from lidario.port.port import Port
from lidario.port.reading import Reader
from lidario.port.serial import open_serial
from lidario.port.thread import ReadingThread, Watched, reading_thread
from tests.support.ports import PATIENCE_S, Sink, terminal_pair

ROOT = Path(__file__).resolve().parents[2]
NAME = "lidario: read ports"


class Clock:
    """A time that the test moves, and a port that notes when it is read."""

    def __init__(self) -> None:
        self.now = 100.0
        self.reads: list[float] = []
        self.dead = False
        self.failures = 0
        self.served = 0
        self._due = 0.0

    def read(self, handle: int) -> bytes:
        self.reads.append(round(self.now, 6))
        if self.dead:
            raise OSError("unplugged")
        return b"x"

    def fail(self) -> None:
        self.failures += 1

    def watched(self, interval: float) -> Watched:
        inbox = Inbox(-1, lambda: round(self.now * 1e9), self.read)
        return Watched(inbox, interval, self.fail)

    def run(self, watched: Watched, seconds: float, late: float = 0.0) -> list[float]:
        """Serve it as often as it asks for, for so long; how many seconds after each other it was read."""
        end, begun = self.now + seconds, len(self.reads)
        while self._due <= end:
            self.now = max(self.now, self._due)
            self._due = watched.serve(self.now, late)
            self.served += 1
            assert self._due > self.now
        self.now = end
        return self.reads[begun:]


def test_a_port_that_nobody_reads_is_read_each_interval() -> None:
    clock = Clock()
    assert clock.run(clock.watched(0.04), 0.21) == [100.04, 100.08, 100.12, 100.16, 100.2]


def test_a_late_thread_reads_more_often() -> None:
    clock = Clock()
    watched = clock.watched(0.04)
    clock.run(watched, 0.1)
    # The kernel's buffer is full after 57 ms.
    reads = clock.run(watched, 0.2, late=0.004)
    assert reads[-1] - reads[-2] == pytest.approx(0.04)
    reads = clock.run(watched, 0.2, late=0.019)
    assert reads[-1] - reads[-2] == pytest.approx(0.025)
    # But not all the time.
    reads = clock.run(watched, 0.2, late=1.0)
    assert reads[-1] - reads[-2] == pytest.approx(0.01)


def test_a_loop_in_time_costs_the_thread_no_wake_up() -> None:
    clock = Clock()
    watched = clock.watched(0.043)
    begin = clock.now
    for _ in range(30):
        watched.inbox.read()
        clock.run(watched, 0.1)
    # As many as it needs where the loop reads nothing: 3 s in steps of 43 ms.
    assert clock.served <= (clock.now - begin) / 0.043 + 1


def test_a_loop_that_is_blocked_at_any_moment_loses_nothing() -> None:
    for blocked_ms in range(100):
        clock = Clock()
        watched = clock.watched(0.043)
        for _ in range(3):
            watched.inbox.read()
            clock.run(watched, 0.1)
        watched.inbox.read()
        clock.run(watched, blocked_ms / 1000)
        reads = [watched.inbox.last_ns * 1e-9, *clock.run(watched, 1.0)]
        assert max(b - a for a, b in pairwise(reads)) <= 0.0431


def test_a_port_that_the_loop_reads_all_the_time_is_left_to_it() -> None:
    clock = Clock()
    watched = clock.watched(0.04)
    for _ in range(200):
        watched.inbox.read()
        loop_read = clock.now
        clock.reads.clear()
        assert watched.serve(clock.now, 0.0) > loop_read
        clock.now += 0.005
    assert clock.reads == []


def test_ports_that_are_due_soon_are_read_together() -> None:
    clock = Clock()
    first, second = clock.watched(0.04), clock.watched(0.042)
    thread = ReadingThread(lambda: clock.now)
    thread._ports += [first, second]  # without starting it
    thread.serve()
    clock.now += 0.04
    thread.serve()
    assert clock.reads == [100.04, 100.04]


def test_a_port_that_was_removed_meanwhile_is_not_read() -> None:
    """The thread has just looked up its ports; a byte that it took now would be seen by nobody."""
    clock = Clock()
    watched = clock.watched(0.04)
    clock.run(watched, 0.1)
    watched.inbox.share(False)
    clock.reads.clear()
    clock.now += 0.04
    watched.serve(clock.now, 0.0)
    assert clock.reads == []


def test_an_error_is_told_and_tried_again() -> None:
    clock = Clock()
    watched = clock.watched(0.04)
    clock.run(watched, 0.1)
    clock.dead = True
    clock.run(watched, 0.1)
    assert clock.failures >= 2
    clock.dead = False
    assert len(clock.run(watched, 0.1)) >= 2


def test_lateness_is_remembered_for_a_while() -> None:
    clock = Clock()
    watched = clock.watched(0.04)
    thread = ReadingThread(lambda: clock.now)
    thread._ports += [watched]  # without starting it
    thread.serve()
    clock.now += 0.05
    thread.note_lateness(0.012)
    assert thread.serve() == pytest.approx(clock.now + 0.02)
    for _ in range(200):
        thread.note_lateness(0.0001)
    clock.now += 0.05
    assert thread.serve() == pytest.approx(clock.now + 0.04)


class Steady:
    """A schedule: nothing is needed, and the port may stay unread for 10 ms."""

    interval = 0.01

    def rest(self, now: float) -> float:
        return 60.0

    def hold(self, now: float) -> float:
        return now + 60.0


def threads() -> list[threading.Thread]:
    return [each for each in threading.enumerate() if each.name == NAME]


def block_until_read(port: Port, size: int) -> None:
    """Block the event loop until the thread has read that many bytes."""
    inbox = port._line._reader._inbox  # type: ignore[union-attr]
    deadline = time.monotonic() + PATIENCE_S
    while inbox.size < size:
        assert time.monotonic() < deadline
        time.sleep(0.001)


async def test_all_ports_share_one_thread_that_ends_with_the_last() -> None:
    with terminal_pair() as one, terminal_pair() as two, terminal_pair() as three:
        ports = [await open_serial(path, 1_000_000) for _, _, path in (one, two, three)]
        sinks = [Sink() for _ in ports]
        assert threads() == []
        for port, sink in zip(ports, sinks, strict=True):
            port.attach(sink)
            port.set_polling(0.005, Steady())
        (thread,) = threads()
        assert thread.daemon
        for number, (master, _, _) in enumerate((one, two, three)):
            os.write(master, bytes([number]) * 4)
        for port in ports:
            block_until_read(port, 4)
        for number, (port, sink) in enumerate(zip(ports, sinks, strict=True)):
            assert threads() == [thread]
            port.set_polling(0.0, None)
            assert sink.chunks == [bytes([number]) * 4]
        assert threads() == []
        assert not reading_thread().is_running
        ports[0].set_polling(0.005, Steady())
        assert len(threads()) == 1
        for port in ports:
            await port.close()
        assert threads() == []


async def test_each_read_has_its_own_time_while_the_loop_is_blocked() -> None:
    with terminal_pair() as (master, _, path):
        port, sink = await open_serial(path, 1_000_000), Sink()
        port.attach(sink)
        seen: list[tuple[bytes, int]] = []
        port.add_tap(lambda direction, data, now: seen.append((data, now)))
        port.set_polling(0.005, Steady())
        written, read = [], []
        for number in range(5):
            written.append(time.monotonic_ns())
            os.write(master, bytes([number]))
            block_until_read(port, number + 1)
            read.append(time.monotonic_ns())
        assert seen == []
        port.poll()
        assert sink.chunks == [b"\0\1\2\3\4"]
        arrivals = [*sink.arrivals[0], (5, sink.times[0])]
        assert [count for count, _ in arrivals] == [1, 2, 3, 4, 5]
        # The taps are shown the same.
        assert seen == [(bytes([number]), at) for number, (_, at) in enumerate(arrivals)]
        for before, (_, at), after in zip(written, arrivals, read, strict=True):
            assert before <= at <= after
        await port.close()


async def test_taps_see_what_the_thread_read_before_what_is_written_later() -> None:
    with terminal_pair() as (master, _, path):
        port = await open_serial(path, 1_000_000)
        seen: list[tuple[str, bytes, int]] = []
        port.add_tap(lambda direction, data, now: seen.append((direction, data, now)))
        port.set_polling(0.005, Steady())
        os.write(master, b"before")
        block_until_read(port, 6)
        port.write(b"request")
        os.write(master, b"after")
        block_until_read(port, 11)
        port.poll()
        assert [(direction, data) for direction, data, _ in seen] == [
            ("in", b"before"),
            ("out", b"request"),
            ("in", b"after"),
        ]
        assert [now for *_, now in seen] == sorted(now for *_, now in seen)
        await port.close()


async def test_beyond_a_mebibyte_the_port_tells_what_it_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.port.inbox.INBOX_BYTES", 6000)
    with terminal_pair() as (master, _, path):
        port, sink = await open_serial(path, 1_000_000), Sink()
        port.attach(sink)
        port.set_polling(0.005, Steady())
        sent, deadline = 0, time.monotonic() + PATIENCE_S
        while port.overflow_bytes < 2000 and time.monotonic() < deadline:
            sent += os.write(master, bytes(1000))
            time.sleep(0.03)  # noqa: ASYNC251 - a program that blocks its loop
        port.poll()
        assert 0 < len(sink.data) <= 6000
        # What comes next is kept.
        os.write(master, b"next")
        while not sink.data.endswith(b"next"):
            assert time.monotonic() < deadline
            port.poll()
        assert port.overflow_bytes + len(sink.data) == sent + 4
        await port.close()


@pytest.mark.parametrize("way", ["pulled", "hung up"])
async def test_the_end_of_a_line_is_noticed_although_the_loop_does_not_poll(way: str) -> None:
    lost: list[Exception] = []
    ended = asyncio.Event()

    def lose(error: Exception) -> None:
        lost.append(error)
        reader.stop()
        ended.set()

    if way == "pulled":
        with terminal_pair() as (master, slave, _):
            os.set_blocking(slave, False)
            reader = Reader(asyncio.get_running_loop(), Port("terminal"), slave, lose)
            reader.set_polling(0.005, Steady())
            os.close(master)
            async with asyncio.timeout(PATIENCE_S):
                await ended.wait()
    else:
        ours, theirs = os.pipe()
        os.set_blocking(ours, False)
        reader = Reader(asyncio.get_running_loop(), Port("pipe"), ours, lose)
        reader.set_polling(0.005, Steady())
        os.close(theirs)
        async with asyncio.timeout(PATIENCE_S):
            await ended.wait()
        os.close(ours)
    assert len(lost) == 1
    assert threads() == []


async def test_a_reader_that_was_thrown_away_is_not_read_for_ever() -> None:
    ours, theirs = os.pipe()
    os.set_blocking(ours, False)
    reader: Reader | None = Reader(asyncio.get_running_loop(), Port("pipe"), ours, print)
    assert reader is not None
    reader.set_polling(0.005, Steady())
    assert len(threads()) == 1
    reader = None
    gc.collect()
    assert threads() == []
    os.close(ours)
    os.close(theirs)


WITH_AN_OPEN_PORT = """
import asyncio, os, pty, sys, tty
sys.path.insert(0, os.getcwd())
from lidario.port.serial import open_serial
from lidario.port.thread import reading_thread
from tests.port.test_thread import Steady, threads

async def main():
    master, slave = pty.openpty()
    tty.setraw(slave)
    port = await open_serial(os.ttyname(slave), 1_000_000)
    port.set_polling(0.005, Steady())
    assert reading_thread().is_running
    return master, slave, port

kept = asyncio.run(main())
"""

EXIT = """
print("done", flush=True)
"""

FORK = """
child = os.fork()
if child == 0:
    assert not reading_thread().is_running
    kept[2].set_polling(0, None)  # the parent's: nothing happens
    kept[2].close_soon()
    assert not threads()
    more = asyncio.run(main())
    assert reading_thread().is_running and len(threads()) == 1
    os.write(more[0], b"x")
    os._exit(7)
_, status = os.waitpid(child, 0)
assert len(threads()) == 1
print("child", os.waitstatus_to_exitcode(status), flush=True)
"""


@pytest.mark.parametrize(("program", "told"), [(EXIT, "done\n"), (FORK, "child 7\n")], ids=["exit", "fork"])
def test_the_thread_keeps_no_program_from_ending_and_a_child_has_its_own(program: str, told: str) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", WITH_AN_OPEN_PORT + program],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        cwd=ROOT,
        check=False,
    )
    assert (done.stdout, done.returncode) == (told, 0), done.stderr
