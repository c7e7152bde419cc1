"""A driver of a serial adapter, below pyserial and below lidario, for a pseudo-terminal that has none.

A pseudo-terminal has no control lines (ENOTTY), counts no errors and has no latency timer. `FakeDriver` takes the
system calls that ask for them, `ioctl` and `open`, and keeps what a kernel keeps. All other calls reach the kernel.
So it shows what lidario asks of a driver, in which order; not what a real adapter does with it.
"""

from __future__ import annotations

import errno
import fcntl
import os
import sys
import termios
from typing import Any

import pytest

__all__ = ["FakeDriver"]

_real_ioctl, _real_open = fcntl.ioctl, os.open


class FakeDriver:
    """The driver of the port `path`.

    Attributes:
        states: DTR and RTS, whether they are high, after each change. Every opening raises both, as Linux does.
    """

    def __init__(self, path: str, patch: pytest.MonkeyPatch) -> None:
        self.states: list[tuple[bool, bool]] = []
        self._path = path
        patch.setattr(fcntl, "ioctl", self._ioctl)
        patch.setattr(os, "open", self._open)

    def _open(self, path: Any, *rest: Any, **named: Any) -> int:
        handle = _real_open(path, *rest, **named)
        if path == self._path:
            self.states.append((True, True))
        return handle

    def _ioctl(self, handle: Any, request: int, argument: Any = 0, *rest: Any) -> Any:
        if request in (termios.TIOCMBIS, termios.TIOCMBIC):
            self._change(int.from_bytes(argument, sys.byteorder), request == termios.TIOCMBIS)
            return argument
        if request in (termios.TIOCMSET, termios.TIOCMGET):
            raise OSError(errno.ENOTTY, "nothing here asks for all lines")
        return _real_ioctl(handle, request, argument, *rest)

    def _change(self, lines: int, high: bool) -> None:
        dtr, rts = self.states[-1]
        if lines & termios.TIOCM_DTR:
            dtr = high
        if lines & termios.TIOCM_RTS:
            rts = high
        self.states.append((dtr, rts))
