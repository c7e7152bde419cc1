"""Ctrl-C is raised at every call that begins or ends a thread of the port, on a loop that does not handle it.

`asyncio.run` turns Ctrl-C into a cancellation. `loop.run_until_complete` does not: KeyboardInterrupt may come in
the midst of `threading.Thread.start`. A program may catch it and go on. So no thread may be left, the next stream
must be read by one as ever, and nothing may hang.
"""

import asyncio
import os
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial

import pytest

from lidario.port.background import run_in_thread
from lidario.port.inbox import Inbox
from lidario.port.port import Port
from lidario.port.serial import open_serial
from lidario.port.thread import ReadingThread, Watched
from tests.port.test_thread import Steady, block_until_read, threads
from tests.support.interrupt import StartedThreads, as_if_running, at_every_call, interrupted_at_call
from tests.support.ports import PATIENCE_S, Sink, terminal_pair

pytestmark = pytest.mark.usefixtures("quick_collection")
INTERVAL_S = 0.005


class Reads:
    """A port that notes in which threads it was read."""

    def __init__(self) -> None:
        self.by: set[threading.Thread] = set()

    def read(self, handle: int) -> bytes:
        self.by.add(threading.current_thread())
        return b"x"

    def watched(self) -> Watched:
        inbox = Inbox(-1, time.monotonic_ns, self.read)
        return Watched(inbox, INTERVAL_S, lambda _: None)


def is_read(thread: ReadingThread, place: str) -> None:
    """The thread reads a port that is added now, and ends with it."""
    reads = Reads()
    watched = reads.watched()
    thread.add(watched)
    deadline = time.monotonic() + PATIENCE_S
    while not reads.by:
        assert time.monotonic() < deadline, f"{place}: it is not read"
        time.sleep(0.0005)
    thread.remove(watched)
    assert len(reads.by) == 1, place


@pytest.mark.parametrize("at", ["add", "remove"])
@pytest.mark.parametrize("others", [False, True])
def test_ctrl_c_at_every_call_of_adding_and_removing(at: str, others: bool) -> None:
    def tried(number: int, started: StartedThreads) -> str:
        thread, other, watched = ReadingThread(), Reads().watched(), Reads().watched()
        if others:
            thread.add(other)
        if at == "remove":
            thread.add(watched)
        place = interrupted_at_call(number, partial(getattr(thread, at), watched))
        thread.remove(watched)
        is_read(thread, place)
        thread.remove(other)
        return place

    assert at_every_call(tried) >= 3


@contextmanager
def plain_loop() -> Iterator[asyncio.AbstractEventLoop]:
    """An event loop that leaves Ctrl-C to the interpreter."""
    with closing(asyncio.new_event_loop()) as loop:
        yield loop
        loop.run_until_complete(asyncio.sleep(0))


@pytest.mark.long
@pytest.mark.parametrize("at", ["begin", "end"])
@pytest.mark.exhaustive("stride", sample=[5], full=[1])
def test_ctrl_c_at_every_call_of_a_stream(at: str, stride: int) -> None:
    with terminal_pair() as (master, _, path), plain_loop() as loop:

        def tried(number: int, started: StartedThreads) -> str:
            port, sink = loop.run_until_complete(open_serial(path, 1_000_000)), Sink()
            port.attach(sink)
            if at == "end":
                port.set_polling(Steady())
            schedule = Steady() if at == "begin" else None
            place = interrupted_at_call(number, partial(port.set_polling, schedule))
            reads_as_ever(port, sink, master, place)
            loop.run_until_complete(port.close())
            started.all_ended(place)
            assert not threads(), place
            return place

        assert at_every_call(tried, stride) * stride > 20


def reads_as_ever(port: Port, sink: Sink, master: int, place: str) -> None:
    """A stream that begins now is read while the loop is blocked."""
    sink.chunks.clear()
    port.set_polling(Steady())
    os.write(master, b"data")
    block_until_read(4)
    deadline = time.monotonic() + PATIENCE_S
    while len(threads()) > 1:
        # One that was started late finds that it is not needed.
        assert time.monotonic() < deadline, place
        time.sleep(0.0005)
    port.set_polling(None)
    assert sink.chunks == [b"data"], place


def test_ctrl_c_at_every_call_of_a_blocking_call() -> None:
    with plain_loop() as loop:

        def tried(number: int, started: StartedThreads) -> str:
            made: list[object] = []
            discarded: list[object] = []
            coroutine = run_in_thread(partial(make, made), discarded.append)
            with as_if_running(loop):
                place = interrupted_at_call(number, partial(coroutine.send, None))
            started.all_ended(place)
            # What the thread has told the loop.
            loop.run_until_complete(asyncio.sleep(0))
            coroutine.close()
            assert discarded == made, place
            return place

        assert at_every_call(tried) > 10


def make(made: list[object]) -> object:
    """A blocking call that notes what it has made."""
    made.append(object())
    return made[-1]
