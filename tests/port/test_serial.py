"""A serial port on a pseudo-terminal: read, written, polled, held, pulled out."""

import asyncio
import os
import termios
import time
from typing import Any

import pytest
import serial

from lidario.errors import ConnectFailed
from lidario.port.line import Schedule
from lidario.port.port import Port
from lidario.port.serial import open_serial
from tests.port.test_thread import Steady, threads
from tests.support.ports import (
    PATIENCE_S,
    OnlyRead,
    Plan,
    Seen,
    Sink,
    on_both_loops,
    open_files,
    opened,
    opened_terminal,
    terminal_pair,
    written,
)


@pytest.mark.usefixtures("system")
@pytest.mark.parametrize("schedule", [None, Plan()], ids=["woken", "polled"])
async def test_every_byte_arrives_in_order(schedule: Plan | None) -> None:
    async with opened_terminal(1_000_000) as (port, sink, master):
        port.set_polling(schedule)
        sent = bytes(range(256)) * 200
        for begin in range(0, len(sent), 1000):
            os.write(master, sent[begin : begin + 1000])
            await sink.until(min(begin + 1000, len(sent)))
        assert bytes(sink.data) == sent
        assert sink.times == sorted(sink.times)
        assert bool(threads()) == (schedule is not None)
    assert threads() == []
    assert sink.lost == [None]


@pytest.mark.usefixtures("system")
async def test_a_write_is_out_before_it_returns(terminal: tuple[int, str]) -> None:
    master, path = terminal
    async with opened(path) as (port, _):
        os.set_blocking(master, False)
        port.write(b"\xa5\x25")
        assert written(master, 2) == b"\xa5\x25"
    port.write(b"too late")
    with pytest.raises(BlockingIOError):
        os.read(master, 16)


@pytest.mark.usefixtures("system")
@pytest.mark.parametrize("schedule", [None, Plan(), Steady()], ids=["woken", "always polled", "seldom polled"])
async def test_a_pulled_cable_is_noticed(schedule: Schedule | None) -> None:
    with terminal_pair() as (master, slave, path):
        async with opened(path) as (port, sink):
            os.close(slave)
            os.write(master, b"the end")
            await sink.until(7)
            port.set_polling(schedule)
            os.close(master)
            error = await sink.until_lost()
            assert "unplugged" in str(error)
            assert isinstance(error.__cause__ if error else None, OSError)
    assert threads() == []


@on_both_loops
async def test_both_event_loops_read_poll_write_and_close() -> None:
    with terminal_pair() as (master, _, path):
        before = open_files()
        async with opened(path, 1_000_000) as (port, sink):
            os.write(master, b"woken, ")
            await sink.until(7)
            port.set_polling(Plan(*[0.01] * 3))
            os.write(master, b"polled")
            await sink.until(13)
            assert bytes(sink.data) == b"woken, polled"
            # Even where the loop's own clock stands still while a callback runs.
            assert sink.times == sorted(sink.times)
            assert abs(sink.times[-1] - time.monotonic_ns()) < 5e9
            port.write(b"out")
            assert written(master, 3) == b"out"
        assert sink.lost == [None]
        assert open_files() == before


@pytest.mark.parametrize("latency", [0.0, 0.005])
async def test_bytes_gather_in_the_kernel_between_two_polls(latency: float) -> None:
    plan = Plan(0.05, 0.0, 0.05, latency=latency)
    async with opened_terminal(1_000_000) as (port, sink, master):
        port.set_polling(plan)
        await asyncio.sleep(0)  # reading starts in the loop's next iteration
        for piece in (b"one ", b"two ", b"three"):
            os.write(master, piece)
        time.sleep(0.1)  # noqa: ASYNC251 - a program that blocks its loop
        await sink.until(13)
        assert sink.chunks == [b"one two three"]
        assert sink.arrivals == [[]]
        os.write(master, b"four")
        await sink.until(17)
        # The rest is over: as `latency` says, from now on.
        assert not plan.rests
        os.write(master, b"five")
        await sink.until(21)
        assert bytes(sink.data) == b"one two threefourfive"


async def test_a_poll_just_before_the_wake_up_is_no_hang_up() -> None:
    async with opened_terminal() as (port, sink, master):
        os.write(master, b"warm up")
        await sink.until(7)
        os.write(master, b"taken")
        # The loop asks which descriptors are readable, then runs this, then the reader, which finds nothing.
        asyncio.get_running_loop().call_soon(port.poll)
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        os.write(master, b" and on")
        await sink.until(19)
        assert bytes(sink.data) == b"warm uptaken and on"
        assert sink.lost == []


async def test_a_loss_that_nobody_was_told_is_told_to_who_comes_next() -> None:
    with terminal_pair() as (master, slave, path):
        port, sink, first = await open_serial(path, 115200), Sink(), Sink()
        port.attach(first)
        port.attach(None)
        os.close(slave)
        os.close(master)
        await port.wait_closed()
        port.attach(sink)
        assert "unplugged" in str(await sink.until_lost())
        assert first.lost == []
        await port.close()


@pytest.mark.parametrize("then", ["", "write", "close"])
async def test_nothing_reads_a_line_that_died_while_it_was_written(ends: tuple[int, int, str], then: str) -> None:
    """Its transport notices, not who reads it."""
    master, slave, path = ends
    port, sink = await open_serial(path, 115200), Sink()
    port.attach(sink)
    # Nothing is needed for a minute: neither the loop nor the thread looks at the line.
    port.set_polling(Plan(*[60.0] * 9, latency=60.0))
    assert threads()
    termios.tcflow(slave, termios.TCOOFF)
    port.write(b"waits")
    reported: list[dict[str, Any]] = []
    failed = asyncio.Event()

    loop = asyncio.get_running_loop()

    def report(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """The transport has met the error; the line is told of it in a later step of the loop."""
        reported.append(context)
        if not failed.is_set():
            failed.set()
            if then == "write":
                loop.call_soon(port.write, b"more")
            if then == "close":
                loop.call_soon(port.close_soon)

    loop.set_exception_handler(report)
    os.close(master)
    error = await sink.until_lost()
    assert (error is None) == (then == "close")
    assert failed.is_set()
    assert threads() == []
    assert not port.is_open
    # The end of the transport does not fail, and nothing is left that ends it again.
    await port.close()
    await asyncio.sleep(0)
    assert len(reported) == 1


@pytest.mark.parametrize("schedule", [None, Steady()], ids=["woken", "read by the thread"])
async def test_a_line_that_was_hung_up_is_noticed(schedule: Schedule | None) -> None:
    """As a USB adapter that is pulled out: readable, and reading returns nothing; here with a pipe."""
    ours, theirs = os.pipe()
    os.set_blocking(ours, False)
    port, sink = Port("pipe"), Sink()
    port.attach(sink)
    reader = OnlyRead(port, ours)
    if schedule is None:
        reader.start()
        os.write(theirs, b"before")
        await sink.until(6)
        reader.poll()
        assert not reader.lost
    else:
        reader.set_polling(schedule)
    os.close(theirs)
    async with asyncio.timeout(PATIENCE_S):
        await reader.ended.wait()
    assert [str(error) for error in reader.lost] == ["the line was hung up"]
    assert threads() == []
    os.close(ours)


async def test_a_tap_that_raises_is_removed_and_costs_nothing(caplog: pytest.LogCaptureFixture) -> None:
    async with opened_terminal() as (port, sink, master):
        calls = []

        def bad(direction: str, data: bytes, now: int) -> None:
            calls.append(direction)
            raise RuntimeError("a mistake in a tap")

        port.add_tap(bad)
        seen = Seen(port)
        port.write(b"\xa5\x25")
        assert written(master, 2) == b"\xa5\x25"
        port.add_tap(bad)
        os.write(master, b"data")
        await sink.until(4)
        assert calls == ["out", "in"]
        assert seen.reads[0][0] == b"data"
        problems = [record for record in caplog.records if record.levelname == "WARNING"]
        assert len(problems) == 2
        assert all(record.exc_info and "mistake in a tap" in str(record.exc_info[1]) for record in problems)
        port.remove_tap(bad)  # not there any more: ignored
        port.remove_tap(seen)
        os.write(master, b"more")
        await sink.until(8)
        assert len(seen.reads) == 1


async def test_a_tap_that_ends_the_program_does_so_once() -> None:
    """The stop requests that are written then are shown to the others alone."""

    def leaves(*_: object) -> None:
        raise SystemExit(5)

    async with opened_terminal() as (port, _, master):
        port.add_tap(leaves)
        with pytest.raises(SystemExit):
            port.write(b"\xa5\x20")
        port.write(b"\xa5\x25")
        assert written(master, 4) == b"\xa5\x20\xa5\x25"


async def test_a_speed_the_adapter_cannot_do(terminal: tuple[int, str], monkeypatch: pytest.MonkeyPatch) -> None:
    _, path = terminal
    port = await open_serial(path, 115200)
    port.set_baudrate(256000)
    assert port.baudrate == 256000

    def fail(self: object) -> None:
        raise termios.error(22, "Invalid argument")

    monkeypatch.setattr(serial.Serial, "reset_input_buffer", fail)
    with pytest.raises(ConnectFailed, match="cannot run at 460800 baud"):
        port.set_baudrate(460800)
    assert port.baudrate == 256000
    await port.close()
