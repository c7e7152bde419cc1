"""A serial port that dies while bytes wait in the program: its transport notices, not who reads it."""

import asyncio
import os
import termios
from typing import Any

import pytest

from lidario.port.serial import open_serial
from tests.port.test_thread import threads
from tests.support.ports import Plan, Sink


@pytest.mark.parametrize("then", ["", "write", "close"])
async def test_nothing_reads_a_line_that_died_while_it_was_written(ends: tuple[int, int, str], then: str) -> None:
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
