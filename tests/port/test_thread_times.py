"""When the thread that reads ports reads them, at times that the test moves."""

from __future__ import annotations

from itertools import pairwise

import pytest

from lidario.port.inbox import Inbox
from lidario.port.thread import ReadingThread, Watched


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

    def fail(self, error: OSError) -> None:
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


def thread_of(clock: Clock, *ports: Watched) -> ReadingThread:
    """One that serves these ports, and was not started."""
    thread = ReadingThread(lambda: clock.now)
    thread.ports.extend(ports)
    return thread


def test_ports_that_are_due_soon_are_read_together() -> None:
    clock = Clock()
    first, second = clock.watched(0.04), clock.watched(0.042)
    thread = thread_of(clock, first, second)
    thread.serve()
    clock.now += 0.04
    thread.serve()
    assert clock.reads == [100.04, 100.04]


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
    thread = thread_of(clock, watched)
    thread.serve()
    clock.now += 0.05
    thread.note_lateness(0.012)
    assert thread.serve() == pytest.approx(clock.now + 0.02)
    for _ in range(200):
        thread.note_lateness(0.0001)
    clock.now += 0.05
    assert thread.serve() == pytest.approx(clock.now + 0.04)
