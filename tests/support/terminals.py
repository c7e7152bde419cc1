"""Pseudo-terminals for tests: one that loses nothing on a busy machine, and one that repeats itself."""

from __future__ import annotations

import os
import pty
import select
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager

from tests.support.speeds import SpeedPtyServer

__all__ = ["WaitingPtyServer", "babbling"]

PATIENCE_S = 30.0
_TURN_S = 0.02


class WaitingPtyServer(SpeedPtyServer):
    """A simulated device that waits while the terminal's buffer is full.

    A real device does not wait: what the buffer cannot take is lost, after about 60 ms without a reader. On a busy
    machine that happens to any test at true pace. With this server, whatever is lost was lost by the reader.
    """

    def _send(self, data: bytes) -> int:
        taken, deadline = 0, time.monotonic() + PATIENCE_S
        while True:
            taken += super()._send(data[taken:])
            if taken == len(data) or self._ending.is_set() or time.monotonic() > deadline:
                return taken
            select.select([self._woken], [], [], _TURN_S)


@contextmanager
def babbling(babble: bytes) -> Iterator[str]:
    """A terminal whose other end answers every request with the same bytes."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    path = os.ttyname(slave)

    def answer() -> None:
        # What was written just before may be read together with it.
        while not os.read(master, 64).endswith(b"END"):
            os.write(master, babble)

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        yield path
    finally:
        os.write(slave, b"END")
        thread.join(PATIENCE_S)
        os.close(slave)
        os.close(master)
