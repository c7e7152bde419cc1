"""When the thread that reads ports reads them, at times that the test moves."""

import threading
from itertools import pairwise
from queue import SimpleQueue

import pytest

from lidario.port.alarm import Alarm
from lidario.port.inbox import Inbox
from lidario.port.thread import ReadingThread, Watched
from tests.support.ports import PATIENCE_S


class Clock:
    """A time that the test moves, and a port that notes when it is read."""

    def __init__(self) -> None:
        self.now = 100.0
        self.reads: list[float] = []
        self.dead = False
        self.failures = 0
        self.served = 0

    def read(self, handle: int) -> bytes:
        self.reads.append(round(self.now, 6))
        if self.dead:
            raise OSError("unplugged")
        return b"x"

    def fail(self, error: OSError) -> None:
        self.failures += 1

    def watched(self, buffer_s: float) -> Watched:
        inbox = Inbox(-1, lambda: round(self.now * 1e9), self.read)
        return Watched(inbox, buffer_s, self.fail)

    def run(self, watched: Watched, seconds: float, late: float = 0.0) -> list[float]:
        """Serve it whenever it is due, for so long; return when it was read."""
        end, begun = self.now + seconds, len(self.reads)
        while (due := watched.due(late)) <= end:
            self.now = max(self.now, due)
            watched.serve(self.now)
            self.served += 1
            assert watched.due(late) > self.now
        self.now = end
        return self.reads[begun:]


def test_a_port_that_nobody_reads_is_read_before_its_buffer_is_full() -> None:
    clock = Clock()
    reads = [100.0, *clock.run(clock.watched(0.05), 0.2)]
    assert [b - a for a, b in pairwise(reads)] == pytest.approx([0.035] * 5)


def test_a_late_thread_reads_more_often() -> None:
    clock = Clock()
    watched = clock.watched(0.057)
    for late, between in ((0.004, 0.0399), (0.019, 0.033), (1.0, 0.0114)):
        reads = clock.run(watched, 0.2, late)
        assert reads[-1] - reads[-2] == pytest.approx(between)


def test_a_loop_in_time_costs_no_wake_up_but_where_the_buffer_holds_no_whole_revolution() -> None:
    for buffer_s, served in ((0.061, 60), (0.08, 30), (0.15, 0)):
        clock = Clock()
        watched = clock.watched(buffer_s)
        for _ in range(30):
            watched.inbox.read()
            clock.run(watched, 0.1)
        assert clock.served == served


def test_a_loop_that_is_blocked_at_any_moment_loses_nothing() -> None:
    for blocked_ms in range(100):
        clock = Clock()
        watched = clock.watched(0.061)
        for _ in range(3):
            watched.inbox.read()
            clock.run(watched, 0.1)
        watched.inbox.read()
        clock.run(watched, blocked_ms / 1000)
        reads = [watched.inbox.last_ns * 1e-9, *clock.run(watched, 1.0)]
        assert max(b - a for a, b in pairwise(reads)) <= 0.0428


def thread_of(clock: Clock, *ports: Watched) -> ReadingThread:
    """One that serves these ports, and was not started."""
    thread = ReadingThread(lambda: clock.now)
    thread.ports.extend(ports)
    return thread


def test_ports_that_are_due_soon_are_read_together() -> None:
    clock = Clock()
    # The last one is due 6.7 ms behind the first.
    thread = thread_of(clock, *map(clock.watched, (0.045, 0.053, 0.0545)))
    clock.now += 0.0315
    thread.serve()
    assert clock.reads == [100.0315, 100.0315]


def test_a_thread_that_was_never_late_sleeps_until_the_buffer_is_nearly_full() -> None:
    clock = Clock()
    assert thread_of(clock, clock.watched(0.05)).serve() == pytest.approx(clock.now + 0.035)


def test_an_error_is_told_and_tried_again() -> None:
    clock = Clock()
    watched = clock.watched(0.04)
    clock.run(watched, 0.1)
    clock.dead = True
    clock.run(watched, 0.1)
    assert clock.failures >= 2
    clock.dead = False
    assert len(clock.run(watched, 0.1)) >= 2


class Noted(Alarm):
    """An alarm on a clock that the test moves, which notes what it is set to."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self.times = SimpleQueue[float]()
        self._clock = clock
        self._rung = threading.Semaphore(0)

    def set(self, at: float) -> None:
        self.at, is_past = at, at <= self._clock.now
        # Behind that the test may move the clock at any moment.
        self.times.put(at)
        if is_past:
            self.ring()

    def ring(self) -> None:
        self._rung.release()

    def wait(self) -> None:
        assert self._rung.acquire(timeout=PATIENCE_S)


def test_lateness_is_remembered_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    alarm = Noted(clock)
    monkeypatch.setattr("lidario.port.thread.make_alarm", lambda: alarm)
    thread, watched = ReadingThread(lambda: clock.now), clock.watched(0.065)
    thread.add(watched)
    due = alarm.times.get(timeout=PATIENCE_S)
    slept: list[float] = []
    for late in (0.002, 0.012, *[0.0001] * 400):
        clock.now = due + late
        alarm.ring()
        due = alarm.times.get(timeout=PATIENCE_S)
        slept.append(due - clock.now)
    assert [*slept[:3], slept[-1]] == pytest.approx([0.0455, 0.024, 0.0258, 0.0455], abs=1e-6)
    thread.remove(watched)


def test_a_loop_that_has_read_puts_off_the_alarm_until_a_port_is_due(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    alarm = Noted(clock)
    monkeypatch.setattr("lidario.port.thread.make_alarm", lambda: alarm)
    thread, ports = ReadingThread(lambda: clock.now), [clock.watched(0.045), clock.watched(0.055)]
    for number, watched in enumerate(ports):
        thread.add(watched)
        if number:
            # To look at it.
            assert alarm.times.get(timeout=PATIENCE_S) == clock.now
        due = alarm.times.get(timeout=PATIENCE_S)
        assert due > clock.now
    begun = clock.now
    # The second one may stay unread for 7 ms longer.
    for at, read, later in ((0.005, 0, 0.005), (0.03, 1, 0.005), (0.03, 0, 0.03)):
        clock.now = begun + at
        ports[read].inbox.read()
        thread.put_off()
        assert alarm.times.get(timeout=PATIENCE_S) == pytest.approx(due + later, abs=1e-6)
    for watched in ports:
        thread.remove(watched)
    assert alarm.times.get(timeout=PATIENCE_S) == clock.now


def test_of_many_ports_not_each_read_looks_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    alarm = Noted(clock)
    monkeypatch.setattr("lidario.port.thread.make_alarm", lambda: alarm)
    thread, ports = ReadingThread(lambda: clock.now), [clock.watched(0.045) for _ in range(9)]
    for watched in ports:
        thread.add(watched)
    # Each is looked at when it comes: the alarm rings, and is set again.
    for _ in range(2 * len(ports) - 1):
        alarm.times.get(timeout=PATIENCE_S)
    thread.put_off()
    assert alarm.times.empty()
    for watched in ports:
        thread.remove(watched)
