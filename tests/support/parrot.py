"""A stand-in for a simulated device, and what tests of its servers need.

It echoes in capitals and can be told to count aloud.
"""

import contextlib
import os
import select
import threading
from collections.abc import Iterator

from lidario.sim.device import Received
from lidario.sim.line import TransmitQueue

BOUND = 20.0  # seconds: no test waits so long unless something is broken


class Parrot:
    """Echoes in capitals; after ``#`` it sends the bytes 0, 1, 2 … 255, 0 … for ever; ``!`` makes it fail."""

    baudrate = 1_000_000
    motor_on = False

    def __init__(self) -> None:
        self.log: list[Received] = []
        self.scanning = False
        self._queue = TransmitQueue(self.baudrate)
        self._next = 0

    def receive(self, data: bytes, now: int) -> None:
        if b"!" in data:
            raise ZeroDivisionError("the parrot is dead")
        if b"#" in data:
            self.scanning, self._next = True, now
        else:
            self._queue.push(data.upper(), now)

    def transmit(self, now: int) -> bytes:
        while self.scanning and self._next <= now:
            self._queue.push(bytes(range(256)), self._next, size=1, period=20_000)
            self._next += 256 * 20_000
        return self._queue.take(now)

    def wakeup(self, now: int) -> int | None:
        at = self._queue.wakeup(now)
        return self._next if at is None and self.scanning else at


@contextlib.contextmanager
def opened(path: str) -> Iterator[int]:
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        yield port
    finally:
        os.close(port)


def read_exactly(port: int, count: int) -> bytes:
    data = b""
    while len(data) < count:
        assert select.select([port], [], [], BOUND)[0], f"only {data!r} came"
        piece = os.read(port, count - len(data))
        assert piece, f"hung up after {data!r}"
        data += piece
    return data


def served() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name == "simulated device"}
