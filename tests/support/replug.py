"""Simulated devices whose cable a test pulls out, and puts in again, when it likes."""

import contextlib
import threading
import time
from typing import Any

from lidario.sim.faults import can_fail
from lidario.sim.serve import PtyServer, TcpServer
from lidario.sim.server import Server


class Replugged(Server):
    """A server with `replug`."""

    def __init__(self, *given: Any, **named: Any) -> None:
        self._pulled = threading.Event()
        self._gap_s: float | None = None
        super().__init__(*given, **named)

    def replug(self, gap_s: float) -> None:
        """Pull the cable out, and put it in again after so many seconds.

        Returns when the client's port is dead; wait for `plugged` to open the new one. The device is without power
        meanwhile, and boots afterwards, if it can.
        """
        self._pulled.clear()
        self._gap_s = gap_s
        with contextlib.suppress(OSError):  # it has just died
            self._waker.send(b"\0")
        while not self._pulled.wait(0.05) and not self.unplugged:
            pass

    def _turn(self) -> bool:
        gap_s, self._gap_s = self._gap_s, None
        if gap_s is None:
            return super()._turn()
        now = time.monotonic_ns()
        with self.lock:
            if can_fail(self.device):
                self.device.reboot(now, off_s=gap_s)
        return self._stay_out(now + round(gap_s * 1e9))

    def _shut(self) -> None:
        super()._shut()  # type: ignore[safe-super] # that of the server beside it
        self._pulled.set()


class ReplugPtyServer(Replugged, PtyServer):
    pass


class ReplugTcpServer(Replugged, TcpServer):
    pass
