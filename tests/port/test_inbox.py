"""Bytes that were read and not handed over yet: all there is, in order, bounded, with the time of each read."""

import contextlib
import fcntl
import os
import re
import struct
import termios
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lidario.port.inbox import CONNECTION, DATAGRAMS, INBOX_BYTES, Inbox, Late, make_read
from tests.support.ports import PATIENCE_S, terminal_pair

FULL = 4095


class Script:
    """A terminal that returns what the test wrote down, then nothing more."""

    def __init__(self, *reads: bytes | Exception) -> None:
        self.reads = list(reads)
        self.now = 0

    def read(self, handle: int) -> bytes:
        self.now += 5
        if not self.reads:
            raise BlockingIOError
        result = self.reads.pop(0)
        if isinstance(result, Exception):
            raise result
        return result

    def inbox(self, late: Late | None = None) -> Inbox:
        return Inbox(-1, lambda: self.now, self.read, late)


def _waiting(handle: int) -> int:
    (count,) = struct.unpack("i", fcntl.ioctl(handle, termios.FIONREAD, bytes(4)))
    return int(count)


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    os.set_blocking(ends[0], False)
    yield ends
    for end in ends:
        os.close(end)


def test_what_waited_together_gets_one_time() -> None:
    """A read returns 4095 bytes at most: the rest of what waited has not come later."""
    inbox = Script(bytes(FULL), bytes(FULL), b"rest", b"not yet").inbox()
    inbox.read()
    chunks, arrivals = inbox.take()
    assert [len(chunk) for chunk in chunks] == [2 * FULL + 4]
    assert arrivals == [(2 * FULL + 4, 15)]


@pytest.mark.parametrize(("stood_s", "came_s"), [(5.0, 0.5), (0.55, 0.55), (0.2, 0.2)])
def test_what_a_full_buffer_kept_of_a_long_time_came_at_its_beginning(stood_s: float, came_s: float) -> None:
    """As where the program was stopped by Ctrl-Z: 5000 bytes of a line that brings 10000 a second."""
    script = Script(*[bytes(100)] * 50, bytes(FULL), bytes(5000 - FULL), bytes(100))
    inbox = script.inbox()
    for _ in range(50):
        script.now += 10_000_000
        with contextlib.suppress(BlockingIOError):
            inbox.read()
    before_ns = script.now
    for passed_s in (stood_s, 0.01):
        script.now += int(passed_s * 1e9)
        inbox.read()
    *_, (size, full_ns), (_, last_ns) = inbox.take()[1]
    assert size == 10_000
    assert full_ns - before_ns == pytest.approx(came_s * 1e9, abs=1e6)
    assert last_ns == inbox.last_ns == script.now


def test_bytes_before_an_error_are_kept() -> None:
    inbox = Script(bytes(FULL), OSError("unplugged"), OSError("unplugged")).inbox()
    inbox.read()
    assert inbox.size == FULL
    with pytest.raises(OSError, match="unplugged"):
        inbox.read()


def test_beyond_a_mebibyte_bytes_are_dropped_and_counted() -> None:
    piece = bytes(1000)
    late = Late()
    inbox = Script(*[piece] * 1100).inbox(late)
    for _ in range(1100):
        inbox.read()
    kept = INBOX_BYTES // 1000 * 1000
    assert (inbox.size, late.overflow_bytes) == (kept, 1_100_000 - kept)
    chunks, arrivals = inbox.take()
    assert sum(map(len, chunks)) == arrivals[-1][0] == kept


@pytest.mark.parametrize("read", [make_read(), None], ids=["one reader", "its own"])
def test_a_real_descriptor_is_read_dry(pipe: tuple[int, int], read: Callable[[int], bytes] | None) -> None:
    inbox = Inbox(pipe[0], lambda: 7, read)
    inbox.read()
    assert inbox.size == 0
    sent = os.urandom(20_000)
    os.write(pipe[1], sent)
    inbox.read()
    assert inbox.take() == ([sent], [(20_000, 7)])


def test_bytes_that_come_right_after_an_empty_read_are_no_end(pipe: tuple[int, int]) -> None:
    """A terminal that is readable and has nothing to read was hung up; here the bytes came between the two."""
    os.write(pipe[1], b"x")
    terminal = Script(b"", b"came")
    inbox = Inbox(pipe[0], lambda: 7, terminal.read)
    inbox.read()
    assert inbox.take() == ([b"came"], [(4, 7)])
    terminal.reads = [b"", b""]
    with pytest.raises(OSError, match="hung up"):
        inbox.read()


def test_the_thread_reads_only_while_the_inbox_is_shared() -> None:
    inbox = Script(b"one", b"two", b"three").inbox()
    inbox.read(from_thread=True)
    inbox.share(False)
    inbox.read(from_thread=True)
    assert inbox.take()[0] == [b"one"]
    inbox.read()
    inbox.share(True)
    inbox.read(from_thread=True)
    assert inbox.take()[0] == [b"two", b"three"]


def test_a_closed_inbox_reads_nothing_and_waits_for_the_read_in_progress() -> None:
    reading, go_on = threading.Event(), threading.Event()

    def slow(handle: int) -> bytes:
        reading.set()
        assert go_on.wait(20)
        return b"slow"

    inbox = Inbox(-1, lambda: 1, slow)
    thread = threading.Thread(target=inbox.read)
    thread.start()
    assert reading.wait(20)
    closing = threading.Thread(target=inbox.close)
    closing.start()
    closing.join(0.05)
    assert closing.is_alive()
    go_on.set()
    closing.join(20)
    thread.join(20)
    assert inbox.take()[0] == [b"slow"]
    inbox.read()
    assert inbox.size == 0


def test_a_read_that_finds_the_buffer_full_is_counted() -> None:
    with terminal_pair() as (ours, theirs, _):
        os.set_blocking(theirs, False)
        os.set_blocking(ours, False)
        late = Late()
        inbox = Inbox(theirs, lambda: 1, late=late)
        os.write(ours, bytes(1000))
        inbox.read()
        assert late.full_reads == 0
        deadline = time.monotonic() + PATIENCE_S
        # What was written reaches the other end a little later.
        while _waiting(theirs) < FULL and time.monotonic() < deadline:
            with contextlib.suppress(BlockingIOError):
                os.write(ours, bytes(4096))
        inbox.read()
        assert late.full_reads == 1


def test_of_a_line_that_never_runs_dry_as_much_is_read_as_the_table_of_bounds_says() -> None:
    page = (Path(__file__).parents[2] / "docs" / "bounds.md").read_text(encoding="utf-8")
    ((kibibytes, datagrams),) = re.findall(r"\| a line is read \| (\d+) KiB, and (\d+) datagrams", page)
    for kind, each, most in ((CONNECTION, 65536, 1024 * int(kibibytes)), (DATAGRAMS, 1, int(datagrams))):
        inbox = Inbox(-1, lambda: 0, lambda _, each=each: bytes(each), kind=kind)  # type: ignore[misc]
        inbox.read()
        assert inbox.size == most
