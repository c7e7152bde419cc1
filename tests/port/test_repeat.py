"""A request that the reading thread repeats while the loop is blocked."""

import math
import os
import time
from itertools import pairwise
from types import SimpleNamespace

import pytest

from lidario.port.thread import Repeat, Served
from tests.port.test_thread import Steady, threads
from tests.support.ports import PATIENCE_S, opened_terminal, written

REQUEST = b"\xa5\x60"


class Line:
    """Notes what is written to it and when, on a clock that the test moves, which serves in the thread's place."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0
        self.written: list[tuple[int, bytes]] = []
        self.dead = False
        self.served: list[Served] = []
        thread = SimpleNamespace(add=self.served.append, remove=self.leave)
        monkeypatch.setattr("lidario.port.thread.reading_thread", lambda: thread)

    def leave(self, served: Served) -> None:
        if served in self.served:
            self.served.remove(served)

    def write(self, data: bytes) -> None:
        if self.dead:
            raise OSError("unplugged")
        self.written.append((self.now, data))

    def repeat(self) -> Repeat:
        made = Repeat(self.write, lambda: self.now)
        made.set(REQUEST, 1.0)
        return made

    def serve_at(self, now: int) -> list[float]:
        """Have it served; return when it is due then."""
        self.now = now
        for each in self.served:
            each.serve(now * 1e-9)
        return [each.due(0.0) for each in self.served]


def test_it_is_written_only_when_the_loop_is_late_and_then_each_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(monkeypatch)
    repeat = line.repeat()
    for step in range(100):
        line.now = step * 50_000_000
        if line.now <= 2_000_000_000 and step % 8 == 0:
            repeat.note()
        (next_at,) = line.serve_at(line.now)
        assert line.now * 1e-9 < next_at < line.now * 1e-9 + 1.001
    assert [at for at, _ in line.written] == [3_000_000_000, 4_000_000_000]
    assert repeat.count == 2
    assert repeat.take_written() == [("out", REQUEST, at * 1_000_000_000) for at in (3, 4)]
    assert repeat.take_written() == []


def test_behind_its_end_nothing_is_written_and_a_dead_line_does_not_raise(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(monkeypatch)
    repeat = line.repeat()
    line.dead = True
    line.serve_at(2_000_000_000)
    assert repeat.count == 0
    line.dead = False
    repeat.set(b"", 0.0)
    assert line.served == []
    assert repeat.due(0.0) == math.inf
    repeat.serve(4.0)
    assert line.written == []


@pytest.mark.long
@pytest.mark.usefixtures("system")
async def test_the_thread_writes_it_while_the_loop_is_blocked_and_taps_see_it_in_order() -> None:
    async with opened_terminal(1_000_000) as (port, _, master):
        seen: list[tuple[str, bytes, int]] = []
        port.add_tap(lambda direction, data, now: seen.append((direction, data, now)))
        port.set_polling(Steady())
        port.set_repeat(REQUEST, 0.1)
        deadline = time.monotonic() + PATIENCE_S
        while port.repeated < 3 and time.monotonic() < deadline:
            os.write(master, b"x")
            time.sleep(0.01)  # noqa: ASYNC251
        while_it_goes_on = port.repeated
        port.set_repeat(b"", 0.0)
        repeated = port.repeated
        assert repeated >= while_it_goes_on >= 3
        assert written(master, repeated * len(REQUEST)) == repeated * REQUEST
        port.poll()
        out = [now for direction, data, now in seen if (direction, data) == ("out", REQUEST)]
        assert len(out) == repeated
        assert [now for *_, now in seen] == sorted(now for *_, now in seen)
        assert min(later - earlier for earlier, later in pairwise(out)) >= 100_000_000


@pytest.mark.parametrize("end", ["close", "abandon"])
async def test_nothing_is_repeated_on_a_port_that_is_closed(end: str) -> None:
    async with opened_terminal(1_000_000) as (port, _, _):
        port.set_repeat(REQUEST, 3600.0)
        assert len(threads()) == 1
        if end == "abandon":
            port.abandon(b"stop")
            assert threads() == []
    assert threads() == []


@pytest.mark.long
async def test_a_tap_does_not_see_what_was_written_before_it_came() -> None:
    async with opened_terminal(1_000_000) as (port, _, master):
        port.set_polling(Steady())
        port.set_repeat(REQUEST, 0.01)
        written(master, len(REQUEST))
        port.set_repeat(REQUEST, 3600.0)
        seen: list[bytes] = []
        port.add_tap(lambda direction, data, now: seen.append(data))
        port.write(b"later")
        assert seen == [b"later"]


def test_what_no_tap_has_seen_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(monkeypatch)
    repeat = line.repeat()
    for second in range(1, 1000):
        line.serve_at(second * 1_000_000_000)
    assert repeat.count == 999
    assert len(repeat.take_written()) == 256
