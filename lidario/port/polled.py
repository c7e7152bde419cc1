"""A serial port that can only be polled: reading and writing by pyserial's own calls, from two threads.

On Windows a serial port has no file descriptor, and no event loop can wait for it. pyserial reads what is there and
returns at once, since its timeout is 0. `PolledLine` and its thread use that as they use a descriptor elsewhere.

Each of pyserial's calls gives the interpreter lock up some times. In a program that computes in another thread the
lock comes back up to 5 ms later each time, so there each read takes 10 to 20 ms.
"""

from __future__ import annotations

import threading

from lidario.port.adapter import Adapter

NO_HANDLE = -1
"""Stands for the file descriptor that the port does not have."""
_READ_SIZE = 4096


class Polled:
    """Reads and writes a port of pyserial that never blocks: both its timeouts are 0."""

    def __init__(self, device: Adapter) -> None:
        self._device = device
        # pyserial has one place for a write in progress, and the thread writes too (`lidario.port.repeat`). Reads
        # have a place of their own; the lock of the inbox divides them.
        # Reentrant: the garbage collector may have a session write its stop requests in the midst of `write`.
        self._lock = threading.RLock()

    def read(self, handle: int) -> bytes:  # noqa: ARG002
        """Return what is there, 4096 bytes at most.

        Raises:
            BlockingIOError: Nothing is there.
            OSError: The port is dead.
        """
        data = self._device.read(_READ_SIZE)
        if not data:
            raise BlockingIOError
        return bytes(data)

    def write(self, data: bytes) -> int:
        """Return how many bytes the system took; OSError where the port is dead."""
        with self._lock:
            return int(self._device.write(data) or 0)
