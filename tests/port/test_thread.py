"""The thread that reads ports while the loop is busy, on real terminals: what it reads, and when it ends."""

import gc
import math
import os
import threading
import time
from collections.abc import Callable, Sequence

import pytest

from lidario.port.port import Port
from lidario.port.serial import open_serial
from lidario.port.thread import ReadingThread, Watched, reading_thread
from tests.support.children import FORKS, ended
from tests.support.ports import PATIENCE_S, OnlyRead, Seen, Sink, opened_terminal, terminal_pair

NAME = "lidario: read ports"


class Steady:
    """A schedule: nothing is needed, and the port must be read within 20 ms."""

    latency = 0.005
    buffer_s = 0.02
    due = math.inf


def threads() -> list[threading.Thread]:
    return [each for each in threading.enumerate() if each.name == NAME]


def block_until_read(size: int) -> None:
    """Block the event loop until the thread has read that many bytes of each port."""
    inboxes = [each.inbox for each in reading_thread().ports if isinstance(each, Watched)]
    assert inboxes
    deadline = time.monotonic() + PATIENCE_S
    while any(inbox.size < size for inbox in inboxes):
        assert time.monotonic() < deadline
        time.sleep(0.001)


def read_one_by_one(
    port: Port, sink: Sink, write: Callable[[bytes], object], shown: Sequence[object] = ()
) -> list[int]:
    """Write five bytes while the loop is blocked, each when the one before was read; when they have arrived.

    Nothing is `shown` to taps meanwhile.
    """
    port.set_polling(Steady())
    written, read = [], []
    for number in range(5):
        written.append(time.monotonic_ns())
        write(bytes([number]))
        block_until_read(number + 1)
        read.append(time.monotonic_ns())
    assert not sink.chunks
    assert not shown
    port.poll()
    assert sink.chunks == [b"\0\1\2\3\4"]
    arrivals = [*sink.arrivals[0], (5, sink.times[0])]
    assert [count for count, _ in arrivals] == [1, 2, 3, 4, 5]
    assert all(before <= at <= after for before, (_, at), after in zip(written, arrivals, read, strict=True))
    return [at for _, at in arrivals]


async def test_all_ports_share_one_thread_that_ends_with_the_last() -> None:
    with terminal_pair() as one, terminal_pair() as two, terminal_pair() as three:
        ports = [await open_serial(path, 1_000_000) for _, _, path in (one, two, three)]
        sinks, taps = [Sink() for _ in ports], [Seen(port) for port in ports]
        assert threads() == []
        for port, sink in zip(ports, sinks, strict=True):
            port.attach(sink)
            port.set_polling(Steady())
        (thread,) = threads()
        assert thread.daemon
        for number, (master, _, _) in enumerate((one, two, three)):
            os.write(master, bytes([number]) * 4)
        block_until_read(4)
        for number, (port, sink) in enumerate(zip(ports, sinks, strict=True)):
            assert threads() == [thread]
            port.set_polling(None)
            # At once: what comes next is another stream, or a response.
            assert sink.chunks == [data for data, _ in taps[number].reads] == [bytes([number]) * 4]
        assert threads() == []
        ports[0].set_polling(Steady())
        assert len(threads()) == 1
        for port in ports:
            await port.close()
        assert threads() == []


class Due:
    """A port that is due once, and knows that it was served."""

    def __init__(self) -> None:
        self.asked = threading.Event()

    def due(self, late: float) -> float:
        return math.inf if self.asked.is_set() else 0.0

    def serve(self, now: float) -> None:
        self.asked.set()


def test_a_port_more_is_served_at_once_however_long_the_thread_would_sleep() -> None:
    thread, first, second = ReadingThread(), Due(), Due()
    thread.add(first)
    try:
        assert first.asked.wait(PATIENCE_S)
        thread.add(second)
        assert second.asked.wait(PATIENCE_S)
    finally:
        thread.remove(first)
        thread.remove(second)
    assert not threads()


async def test_each_read_has_its_own_time_while_the_loop_is_blocked() -> None:
    async with opened_terminal(1_000_000) as (port, sink, master):
        seen: list[tuple[bytes, int]] = []
        port.add_tap(lambda direction, data, now: seen.append((data, now)))
        times = read_one_by_one(port, sink, lambda data: os.write(master, data), seen)
        # The taps are shown the same.
        assert seen == [(bytes([number]), at) for number, at in enumerate(times)]


async def test_taps_see_what_the_thread_read_before_what_is_written_later() -> None:
    with terminal_pair() as (master, _, path):
        port = await open_serial(path, 1_000_000)
        seen: list[tuple[str, bytes, int]] = []
        port.add_tap(lambda direction, data, now: seen.append((direction, data, now)))
        port.set_polling(Steady())
        os.write(master, b"before")
        block_until_read(6)
        port.write(b"request")
        os.write(master, b"after")
        block_until_read(5)
        port.poll()
        assert [(direction, data) for direction, data, _ in seen] == [
            ("in", b"before"),
            ("out", b"request"),
            ("in", b"after"),
        ]
        assert [now for *_, now in seen] == sorted(now for *_, now in seen)
        await port.close()


@pytest.mark.long
async def test_beyond_a_mebibyte_the_port_tells_what_it_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.port.inbox.INBOX_BYTES", 6000)
    async with opened_terminal(1_000_000) as (port, sink, master):
        port.set_polling(Steady())
        sent, deadline = 0, time.monotonic() + PATIENCE_S
        while port.late.overflow_bytes < 2000 and time.monotonic() < deadline:
            sent += os.write(master, bytes(1000))
            time.sleep(0.03)  # noqa: ASYNC251 - a program that blocks its loop
        port.poll()
        assert 0 < len(sink.data) <= 6000
        # What comes next is kept.
        os.write(master, b"next")
        while not sink.data.endswith(b"next"):
            assert time.monotonic() < deadline
            port.poll()
        assert port.late.overflow_bytes + len(sink.data) == sent + 4


async def test_a_reader_that_was_thrown_away_is_not_read_for_ever() -> None:
    ours, theirs = os.pipe()
    os.set_blocking(ours, False)
    reader: OnlyRead | None = OnlyRead(Port("pipe"), ours)
    assert reader is not None
    assert reader.repeat is not None
    reader.set_polling(Steady())
    reader.repeat.set(b"keep on", 60.0)
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
from lidario.port.thread import ReadingThread, Watched, reading_thread
from tests.port.test_thread import Steady, threads

async def main():
    master, slave = pty.openpty()
    tty.setraw(slave)
    port = await open_serial(os.ttyname(slave), 1_000_000)
    port.set_polling(Steady())
    assert threads()
    return master, slave, port

kept = asyncio.run(main())
"""

EXIT = """
print("done", flush=True)
"""

FORK = """
child = os.fork()
if child == 0:
    assert not threads()
    kept[2].set_polling(None)  # the parent's: nothing happens
    kept[2].close_soon()
    assert not threads()
    more = asyncio.run(main())
    assert len(threads()) == 1
    os.write(more[0], b"x")
    os._exit(7)
_, status = os.waitpid(child, 0)
assert len(threads()) == 1
print("child", os.waitstatus_to_exitcode(status), flush=True)
"""


@pytest.mark.long
@pytest.mark.parametrize(("program", "told"), [(EXIT, "done\n"), (FORK, "child 7\n")], ids=["exit", "fork"])
def test_the_thread_keeps_no_program_from_ending_and_a_child_has_its_own(program: str, told: str) -> None:
    done = ended(FORKS + WITH_AN_OPEN_PORT + program)
    assert (done.stdout, done.returncode) == (told, 0), done.stderr
