"""A driver of a serial adapter, below pyserial and below lidario, for a pseudo-terminal that has none.

A pseudo-terminal has no control lines (ENOTTY), counts no errors and has no latency timer. `FakeDriver` takes the
system calls that ask for them, `ioctl` and `open`, and keeps what a kernel keeps. All other calls reach the kernel.
So it shows what lidario asks of a driver, in which order; not what a real adapter does with it.
"""

import ctypes
import errno
import fcntl
import os
import sys
import termios
from pathlib import Path
from typing import Any

import pytest

LOW_LATENCY = 0x2000
FLAGS_AT = 4
"""Their place in ``struct serial_struct``, behind the type, line, port and interrupt."""
SPEED_FLAG = 0x0010
"""Another flag, which nobody may change."""

_ASKED = (termios.TIOCMBIS, termios.TIOCMBIC, termios.TIOCGSERIAL, termios.TIOCSSERIAL, termios.TIOCGICOUNT)
_real_ioctl, _real_open = fcntl.ioctl, os.open


class _Counters(ctypes.Structure):
    """``struct serial_icounter_struct`` of ``linux/serial.h``."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("cts", "dsr", "rng", "dcd", "rx", "tx", "frame", "overrun", "parity")),
        *((name, ctypes.c_int) for name in ("brk", "buf_overrun")),
        ("reserved", ctypes.c_int * 9),
    )


class FakeDriver:
    """The driver of the port `path`.

    Args:
        path: The name of the pseudo-terminal.
        patch: Undoes it all at the end of the test.
        root: A folder in whose ``sys`` the driver shows its latency timer; None for a driver that has none.

    Attributes:
        states: DTR and RTS, whether they are high, after each change. Every opening raises both, as Linux does.
        counted: What it has counted, by the kernel's names; None for a driver that counts nothing.
    """

    def __init__(self, path: str, patch: pytest.MonkeyPatch, root: Path | None = None) -> None:
        self.states: list[tuple[bool, bool]] = []
        self.flags = SPEED_FLAG  # those of ``struct serial_struct``, of which low latency is one
        self.settings = 0  # how often the flags were set
        self.counted: dict[str, int] | None = None
        self.fails = False  # whether setting the flags fails
        self.gone = False  # whether the adapter was pulled out
        self._path = path
        self._timer: Path | None = None
        if root is not None:
            self._timer = root / "sys/class/tty" / os.path.basename(path) / "device/latency_timer"
            self._timer.parent.mkdir(parents=True)
            patch.setattr("lidario.port.adapter.ROOT", root)
            self.show_latency()
        patch.setattr(fcntl, "ioctl", self._ioctl)
        patch.setattr(os, "open", self._open)

    def _open(self, path: Any, *rest: Any, **named: Any) -> int:
        handle = _real_open(path, *rest, **named)
        if path == self._path:
            self.states.append((True, True))
        return handle

    def _ioctl(self, handle: Any, request: int, argument: Any = 0, *rest: Any) -> Any:
        if self.gone and request in _ASKED:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        if request in (termios.TIOCMBIS, termios.TIOCMBIC):
            self._change(int.from_bytes(argument, sys.byteorder), request == termios.TIOCMBIS)
            return argument
        if request in (termios.TIOCMSET, termios.TIOCMGET):
            raise OSError(errno.ENOTTY, "nothing here asks for all lines")
        if request == termios.TIOCGSERIAL and self._timer is not None:
            memoryview(argument).cast("B").cast("i")[FLAGS_AT] = self.flags
            return 0
        if request == termios.TIOCSSERIAL and self._timer is not None:
            if self.fails:
                raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))
            self.flags = memoryview(argument).cast("B").cast("i")[FLAGS_AT]
            self.settings += 1
            self.show_latency()
            return 0
        if request == termios.TIOCGICOUNT and self.counted is not None:
            return bytes(_Counters(cts=1, dsr=2, rng=3, dcd=4, rx=50_000, tx=60, **self.counted))
        return _real_ioctl(handle, request, argument, *rest)

    def show_latency(self) -> None:
        """Write what the driver shows in ``sys``, as Linux' driver of FTDI adapters does."""
        assert self._timer is not None
        self._timer.write_text("1\n" if self.flags & LOW_LATENCY else "16\n", encoding="ascii")

    def _change(self, lines: int, high: bool) -> None:
        dtr, rts = self.states[-1]
        if lines & termios.TIOCM_DTR:
            dtr = high
        if lines & termios.TIOCM_RTS:
            rts = high
        self.states.append((dtr, rts))
