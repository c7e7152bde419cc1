"""A program that blocks its event loop loses nothing: its port is read all the same, however slow the machine is.

That whole revolutions come of it is tested on a driven clock (`tests/session/test_blocked_loop.py`).
"""

import os
import random
import threading
import time
from collections.abc import Callable

import pytest

from tests.support.ports import PATIENCE_S, Plan, opened_terminal

SENT = random.Random(7).randbytes(3 * 20480)
"""Three times what a pseudo-terminal holds: it can only be written while it is read."""


def sleep() -> None:
    time.sleep(0.001)


def compute() -> None:
    sum(range(200))


@pytest.mark.long
@pytest.mark.usefixtures("system")
@pytest.mark.parametrize("work", [sleep, compute])
async def test_a_blocked_loop_loses_nothing(work: Callable[[], None]) -> None:
    """The one lets other threads run, the other makes them wait for the interpreter."""
    async with opened_terminal(1_000_000) as (port, sink, master):
        port.set_polling(Plan(*[60.0] * 100, buffer_s=0.02))
        written = threading.Event()

        def write() -> None:
            sent = 0
            while sent < len(SENT):
                sent += os.write(master, SENT[sent : sent + 4096])
            written.set()

        writer = threading.Thread(target=write, daemon=True)
        writer.start()
        deadline = time.monotonic() + PATIENCE_S
        while not written.is_set() and time.monotonic() < deadline:
            work()
        assert written.is_set()
        assert not sink.chunks
        await sink.until(len(SENT))
        writer.join()
    assert sink.data == SENT
