"""Pseudo-terminals for tests: one that loses nothing on a busy machine, and one that repeats itself."""

import os
import select
import time
from pathlib import Path

from lidario.sim.device import SimulatedDevice
from tests.support.replug import Replugged
from tests.support.speeds import SpeedPtyServer

PATIENCE_S = 30.0
_TURN_S = 0.02


class WaitingPtyServer(Replugged, SpeedPtyServer):
    """A simulated device that waits while the terminal's buffer is full.

    A real device does not wait: what the buffer cannot take is lost, after about 60 ms without a reader. On a busy
    machine that happens to any test at true pace. With this server, whatever is lost was lost by the reader.

    It keeps every name that it has had until it is closed. A session looks for its lidar where it was opened first,
    also after the second replug, and another test process may get that name as soon as it is free.

    With `link` a symbolic link leads to the port, as Linux makes one in ``/dev/serial/by-id``; it is gone while the
    cable is out.
    """

    _link: Path | None = None

    def __init__(self, device: SimulatedDevice, *, chunk: int | None = None) -> None:
        self._earlier: list[int] = []
        super().__init__(device, chunk=chunk)

    def link(self, path: Path) -> None:
        with self.lock:
            self._link = path
            path.symlink_to(self.path)

    def _plug_in(self) -> None:
        super()._plug_in()
        if self._link is not None:
            self._link.symlink_to(self.path)

    def _shut(self) -> None:
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        super()._shut()

    def _let_go(self) -> None:
        if self._held >= 0:
            self._earlier.append(self._held)
            self._held = -1

    def close(self) -> None:
        try:
            super().close()
        finally:
            while self._earlier:
                os.close(self._earlier.pop())

    def _send(self, data: bytes) -> int:
        taken, deadline = 0, time.monotonic() + PATIENCE_S
        while True:
            taken += super()._send(data[taken:])
            if taken == len(data) or self._ending.is_set() or time.monotonic() > deadline:
                return taken
            select.select([self._woken], [], [], _TURN_S)
