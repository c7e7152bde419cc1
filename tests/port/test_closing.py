"""Closing a serial port whose adapter sends nothing any more: bounded, and the event loop goes on."""

import asyncio
import errno
import logging
import os
import stat
import termios
import threading

import pytest
import serial

from lidario.port.port import Port
from lidario.port.serial import DRAIN_S, open_serial
from lidario.port.simulated import MemoryTransport, connect_in_memory
from tests.support.children import until
from tests.support.devices import make_rig
from tests.support.loop import driven, driven_loop, now
from tests.support.ports import PATIENCE_S, Sink, open_files, opened, written


class Wedged:
    """An adapter that does not send what is left in it, as pyserial and the kernel show it.

    Attributes:
        left: Bytes in the adapter; a number, or one for each time that is asked.
        discards: Whether the driver can throw them away.
        discarded: How often it was asked to.
        waits: How often somebody has waited until it is empty, which it never is.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *left: int, discards: bool = True) -> None:
        self.left = list(left)
        self.discarded = self.waits = 0
        wedged = self

        def waiting(_: serial.Serial) -> int:
            return wedged.left.pop(0) if len(wedged.left) > 1 else wedged.left[0]

        def discard(_: serial.Serial) -> None:
            wedged.discarded += 1
            if discards:
                wedged.left = [0]

        def flush(_: serial.Serial) -> None:
            wedged.waits += bool(wedged.left[-1])

        monkeypatch.setattr(serial.Serial, "out_waiting", property(waiting))
        monkeypatch.setattr(serial.Serial, "reset_output_buffer", discard)
        monkeypatch.setattr(serial.Serial, "flush", flush)


async def closed_in(port: Port) -> float:
    """Close `port`; how long that took."""
    began = now()
    await port.close()
    return now() - began


@driven
async def test_an_adapter_that_sends_nothing_stops_neither_the_loop_nor_the_close(
    ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with opened(ends[2]) as (port, sink):
        wedged = Wedged(monkeypatch, 7)
        port.write(b"stop")
        assert await closed_in(port) == pytest.approx(DRAIN_S, abs=0.003)
    assert (wedged.discarded, wedged.waits) == (1, 0)
    assert sink.lost == [None]
    assert "closed before all was sent" in caplog.text


@driven
async def test_one_that_was_pulled_out_is_not_waited_for(
    ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Its driver no longer tells how much waits; the transport has not noticed yet."""

    def gone(_: serial.Serial) -> int:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    port = await open_serial(ends[2], 115200)
    monkeypatch.setattr(serial.Serial, "out_waiting", property(gone))
    port.write(b"stop")
    assert await closed_in(port) == pytest.approx(0.0, abs=0.003)
    assert "closed before" not in caplog.text


@driven
async def test_a_terminal_that_takes_nothing(ends: tuple[int, int, str]) -> None:
    master, slave, path = ends
    before = open_files()
    port = await open_serial(path, 115200)
    termios.tcflow(slave, termios.TCOOFF)
    port.write(b"stop")
    assert await closed_in(port) == pytest.approx(DRAIN_S, abs=0.003)
    assert open_files() == before
    os.set_blocking(master, False)
    with pytest.raises(BlockingIOError):
        os.read(master, 16)


@driven
async def test_closing_waits_while_bytes_leave(ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch) -> None:
    port = await open_serial(ends[2], 115200)
    wedged = Wedged(monkeypatch, 4, 3, 2, 1, 0)
    port.write(b"stop")
    await port.close()
    assert (wedged.left, wedged.discarded) == ([0], 0)
    assert written(ends[0], 4) == b"stop"


@driven
async def test_stop_requests_leave_before_the_port_is_closed(ends: tuple[int, int, str]) -> None:
    master, slave, path = ends
    port = await open_serial(path, 115200)
    order: list[str] = []
    port.on_close = lambda: order.append(f"closed, {open_files()} files")
    before = open_files()
    # The terminal takes nothing for a moment, so that the bytes wait in the program.
    termios.tcflow(slave, termios.TCOOFF)
    port.write(b"stop")
    port.close_soon()
    assert not port.is_open
    assert port.is_closing
    asyncio.get_running_loop().call_later(0.05, termios.tcflow, slave, termios.TCOON)
    await port.wait_closed()
    assert written(master, 4) == b"stop"
    # One descriptor of the terminal and the four that pyserial keeps beside it were closed when this was said.
    assert order == [f"closed, {before - 5} files"]


@driven
async def test_a_driver_that_cannot_discard_is_closed_off_the_loop(
    ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel makes the last close of such a port wait for up to 30 s."""
    before = open_files()
    port = await open_serial(ends[2], 115200)
    closed: list[threading.Thread] = []
    close = os.close

    def closing(handle: int) -> None:
        if stat.S_ISCHR(os.fstat(handle).st_mode):
            closed.append(threading.current_thread())
        close(handle)

    Wedged(monkeypatch, 7, discards=False)
    monkeypatch.setattr(os, "close", closing)
    await port.close()
    until(lambda: len(closed) == 2 and open_files() <= before)
    (other,) = [thread for thread in closed if thread is not threading.current_thread()]
    assert other.daemon


@driven
async def test_it_is_closed_on_the_loop_where_the_system_allows_no_more_threads(
    ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    before = open_files()
    port = await open_serial(ends[2], 115200)
    Wedged(monkeypatch, 7, discards=False)
    monkeypatch.setattr(threading.Thread, "start", refuse)
    await port.close()
    assert not port.is_open
    until(lambda: open_files() <= before)


@driven
async def test_a_line_that_does_not_close_is_given_up_after_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """As docs/bounds.md says."""
    monkeypatch.setattr(MemoryTransport, "abort", MemoryTransport.close)
    monkeypatch.setattr(MemoryTransport, "close", lambda _: None)
    port = connect_in_memory(make_rig("rplidar").device)
    assert await closed_in(port) == pytest.approx(1.0)
    assert not port.is_open


@driven
async def test_cancelling_only_ends_the_wait(ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch) -> None:
    port = await open_serial(ends[2], 115200)
    Wedged(monkeypatch, *[5] * 20, 0)
    task = asyncio.create_task(port.close())
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert not port.is_open
    await port.wait_closed()


@driven
async def test_a_loop_blocked_while_it_closed(ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(ends[2]) as (port, sink):
        Wedged(monkeypatch, 7)
        port.close_soon()
        await asyncio.sleep(0)
        driven_loop().block(2.0)  # both bounds of the close are passed when the loop goes on
        await port.wait_closed()
    assert sink.lost == [None]


async def test_closing_twice_or_after_the_end(ends: tuple[int, int, str], caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, "lidario")
    async with opened(ends[2]) as (port, sink):
        port.is_closing = True
        assert port.is_open
        assert port.is_closing
        await asyncio.gather(port.close(), port.close())
    port.close_soon()
    port.poll()
    port.set_polling(None)
    port.abandon(b"stop")
    assert sink.lost == [None]
    states = [record.getMessage().removeprefix(ends[2]) for record in caplog.records]
    assert states == [" is open", " is closed"]


async def test_a_close_in_the_iteration_of_the_opening(ends: tuple[int, int, str]) -> None:
    port, sink = await open_serial(ends[2], 115200), Sink()
    port.attach(sink)
    port.close_soon()
    await port.wait_closed()
    os.write(ends[0], b"late")
    await asyncio.sleep(0)
    assert sink.lost == [None]
    assert not sink.data


@pytest.mark.parametrize(("ahead", "waited"), [(0.045, 0.045), (3600.0, 0.05), (-1.0, 0.0)])
@driven
async def test_abandon_waits_for_the_device(
    ahead: float, waited: float, ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    slept: list[float] = []
    monkeypatch.setattr("lidario.port.port.time.sleep", slept.append)
    port = await open_serial(ends[2], 115200)
    slept.clear()
    port.abandon(b"stop", now() + ahead)
    assert sum(slept) == pytest.approx(waited)
    assert written(ends[0], 4) == b"stop"
    await port.wait_closed()


def test_abandon_after_the_loop_was_closed(ends: tuple[int, int, str]) -> None:
    master, _, path = ends
    ended: list[str] = []
    with asyncio.Runner() as runner:
        port = runner.run(open_serial(path, 115200))
        port.on_close = lambda: ended.append("ended")
    port.write(b"written, ")
    port.set_polling(None)
    port.poll()
    port.abandon(b"stop")
    assert written(master, 13) == b"written, stop"
    assert ended == ["ended"]
    port.abandon(b"again")
    port.close_soon()


def test_abandon_from_another_thread(ends: tuple[int, int, str]) -> None:
    async def main() -> None:
        port, sink = await open_serial(ends[2], 115200), Sink()
        port.attach(sink)
        thread = threading.Thread(target=port.abandon, args=(b"stop",))
        thread.start()
        assert await sink.until_lost() is None
        thread.join(PATIENCE_S)

    asyncio.run(main())
    assert written(ends[0], 4) == b"stop"
