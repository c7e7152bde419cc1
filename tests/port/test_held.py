"""Bytes that a serial port holds back, to hand them over in one piece."""

import asyncio
import math
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import pytest

from lidario.port.port import Port
from lidario.port.thread import Watched, reading_thread
from tests.support.loop import driven, now, until
from tests.support.ports import PATIENCE_S, Plan, Seen, Sink, opened, terminal_pair
from tests.test_exhausted import no_threads


@asynccontextmanager
async def held_port(path: str, plan: Plan) -> AsyncIterator[tuple[Port, Sink, Seen]]:
    """A port that is polled every 2 ms and holds what it reads as long as `plan` says, however long that is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lidario.port.reading.HOLD_S", 3600.0)
        async with opened(path, 1_000_000) as (port, sink):
            port.set_polling(plan)
            yield port, sink, Seen(port)


async def until_read(size: int) -> None:
    """Return when so many bytes were read, by the loop or the thread."""
    (watched,) = (each for each in reading_thread().ports if isinstance(each, Watched))
    await until(lambda: watched.inbox.size >= size)


async def test_what_is_held_comes_in_one_piece_with_the_time_of_each_read(terminal: tuple[int, str]) -> None:
    master, path = terminal
    plan = Plan(hold=math.inf, latency=0.002)
    async with held_port(path, plan) as (_, sink, seen):
        for count, piece in enumerate((b"one", b"three", b"seven77"), start=1):
            os.write(master, piece)
            await until_read((3, 8, 15)[count - 1])
            assert not sink.chunks
        plan.until = 0.0
        await sink.until(15)
        assert sink.chunks == [b"onethreeseven77"]
        # The taps were shown each read at its own time, and the receiver is told the same times.
        first, second, third = (now for _, now in seen.reads)
        assert first < second < third
        assert sink.arrivals == [[(3, first), (8, second)]]
        assert sink.times == [third]


@driven
async def test_nothing_is_held_for_longer_than_half_a_second(terminal: tuple[int, str]) -> None:
    master, path = terminal
    async with opened(path, 1_000_000) as (port, sink):
        # A schedule that makes no sense: nothing is ever needed.
        port.set_polling(Plan(*[3600.0] * 10))
        seen = Seen(port)
        os.write(master, b"here")
        await sink.until(4)
        assert now() - seen.reads[0][1] * 1e-9 == pytest.approx(0.5)


async def test_the_loop_sleeps_while_the_thread_reads(terminal: tuple[int, str]) -> None:
    """In the second stream of a session, too."""
    master, path = terminal
    plans = [Plan(*[0.9] * 10, hold=math.inf, buffer_s=0.02) for _ in range(2)]
    async with held_port(path, plans[0]) as (port, sink, _):
        for number, plan in enumerate(plans):
            port.set_polling(plan)
            for count in range(1, 11):
                os.write(master, b"x")
                await until_read(count)
            # It would have polled fifteen times.
            assert plan.rests
            assert len(sink.chunks) == number
            port.set_polling(None)
            await sink.until(10 * number + 10)


async def test_where_no_thread_can_be_started_the_loop_reads_before_the_buffer_is_full(
    terminal: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lidario.port.reading.HOLD_S", 3600.0)
    master, path = terminal
    async with opened(path, 1_000_000) as (port, sink):
        with no_threads():
            port.set_polling(Plan(*[60.0] * 100_000, buffer_s=0.02))
        os.set_blocking(master, False)
        async with asyncio.timeout(PATIENCE_S):
            # Many times what the system keeps.
            while len(sink.data) < 500_000:
                with suppress(BlockingIOError):
                    os.write(master, bytes(4096))
                await asyncio.sleep(0.001)


async def test_no_more_than_32_kib_are_held(terminal: tuple[int, str]) -> None:
    master, path = terminal
    async with held_port(path, Plan(hold=math.inf, latency=0.002)) as (_, sink, _):
        for count in range(1, 9):
            assert not sink.chunks
            os.write(master, bytes(4096))
            await (until_read(4096 * count) if count < 8 else sink.until(32768))
        assert [len(chunk) for chunk in sink.chunks] == [32768]


class Overdue:
    """A schedule by which a revolution is late, and when it was looked at."""

    buffer_s = 1.0
    latency = 0.005

    def __init__(self) -> None:
        self.seen = list[float]()

    @property
    def due(self) -> float:
        self.seen.append(now())
        return 0.0


@pytest.mark.parametrize(("latency", "pause"), [(0.01, 0.009), (0.005, 0.004), (0.001, 0.0005)])
@driven
async def test_what_is_overdue_is_polled_within_the_latency_by_a_late_timer(latency: float, pause: float) -> None:
    overdue = Overdue()
    overdue.latency = latency
    with terminal_pair() as (_, _, path):
        async with opened(path, 1_000_000) as (port, _):
            port.set_polling(overdue)
            await asyncio.sleep(3.5 * pause)
    begun, *polled = sorted(set(overdue.seen))
    assert [at - begun for at in polled] == pytest.approx([pause, 2 * pause, 3 * pause])


@pytest.mark.parametrize("way", ["poll", "set_polling", "close", "pulled"])
async def test_what_is_held_is_not_lost(way: str) -> None:
    with terminal_pair() as (master, slave, path):
        async with held_port(path, Plan(hold=math.inf, latency=0.002)) as (port, sink, _):
            os.write(master, b"held")
            await until_read(4)
            assert not sink.chunks
            if way == "poll":
                os.write(master, b", and not yet read")
                port.poll()
                assert b"".join(sink.chunks) == b"held, and not yet read"
                assert len(sink.chunks) == 1
            elif way == "set_polling":
                port.set_polling(None)
                assert sink.chunks == [b"held"]
            elif way == "pulled":
                os.close(slave)
                os.close(master)
                assert await sink.until_lost() is not None
                assert sink.chunks == [b"held"]
        assert bytes(sink.data).startswith(b"held")
