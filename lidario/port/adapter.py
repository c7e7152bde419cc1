"""pyserial's port, opened so that no control line disturbs what is on it.

Linux raises DTR and RTS at every opening, before any program can say a word. Who then clears DTR alone leaves the
pair that holds a board with an ESP32 in reset: its two transistors pull EN low where DTR is low and RTS high. Such
boards have the same adapters as lidars (CP2102, CH340), so looking for a lidar would stop them. Here RTS is cleared
first, then DTR: no state on the way is that pair, and in the last one both are low, as if the port were closed.

No lidar needs RTS. The plugs of their data sheets have no pin for it (power, RX, TX, and on some a control line of
the motor, which the vendors' USB boards join to DTR), the UART of a Raspberry Pi has no RTS and drives them, and of
the vendors' own drivers for Windows one opens its port with RTS disabled.

An FTDI adapter gathers bytes for 16 ms before it sends them on. Where its driver has low latency, it is set while
the port is open: then it is 1 ms. It is set before the first request, since changing it can hold up a stream for a
quarter of a second, and given back when the port is closed. For a program that is killed its guard gives it back
(`lidario.port.guard`); without one it stays until the adapter is unplugged. Who finds it set leaves it set.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys

import serial

from lidario.port import driver

__all__ = ["FOREIGN", "Adapter"]

_POSIX = os.name == "posix"
_NO_LINES = (errno.ENOTTY, errno.EINVAL)
"""What a terminal without control lines says of them, such as a pseudo-terminal."""

FOREIGN: tuple[type[Exception], ...] = (OSError, ValueError, OverflowError)
"""What pyserial and the system raise; pyserial's own exceptions are OSErrors."""
if sys.platform != "win32":
    import termios

    # pyserial lets it through in places, and it is no OSError.
    FOREIGN = (*FOREIGN, termios.error)


class Adapter(serial.Serial):  # type: ignore[misc]
    """pyserial's port, without the wait that pyserial-asyncio makes on the event loop when it closes."""

    _hurried_by = 0
    """The process that has set low latency; 0 for none. A forked child gives nothing back."""

    def open(self) -> None:
        """Open exclusively, with RTS and DTR cleared; blocks.

        Models without a motor command run while DTR is low; pyserial would raise it and stop them.

        Raises:
            Exception: One of `FOREIGN`.
        """
        self.exclusive = _POSIX or None
        self.dtr = self.rts = False
        # So pyserial clears RTS alone, and DTR is cleared after it. Windows is told both at once.
        self.dsrdtr = _POSIX
        super().open()
        if _POSIX:
            try:
                self.dtr = False
            except OSError as error:
                if error.errno not in _NO_LINES:
                    raise

    def flush(self) -> None:
        """Do nothing: whoever closes has waited already. pyserial's own blocks until the last byte is out."""

    def close(self) -> None:
        """Close, and give back what `hurry` has set. May be called twice."""
        if self._hurried_by == os.getpid() and self.is_open:
            with contextlib.suppress(*FOREIGN):  # it is unplugged
                self.set_low_latency_mode(False)
        self._hurried_by = 0
        super().close()

    def hurry(self) -> None:
        """Have an adapter that gathers bytes send them on at once, until the port is closed. Never raises."""
        latency = driver.latency_ms(str(self.port), driver.ROOT)
        if latency is None or latency <= 1:
            return
        with contextlib.suppress(*FOREIGN, NotImplementedError):
            self.set_low_latency_mode(True)
            self._hurried_by = os.getpid()

    @property
    def is_hurried(self) -> bool:
        """Whether `hurry` has set low latency."""
        return self._hurried_by != 0

    def refuse_others(self) -> None:
        """Have the system refuse to open the terminal once more."""
        import fcntl  # not on Windows
        import termios

        fcntl.ioctl(self.fileno(), termios.TIOCEXCL)

    def keep_lines_at_close(self) -> None:
        """Have the system leave DTR as it is when the port is closed; by itself it clears it.

        A motor that runs while DTR is cleared would start then. The setting stays with the port, and does no harm:
        who opens it next sets DTR as it needs it.
        """
        import termios  # not on Windows

        settings = termios.tcgetattr(self.fileno())
        settings[2] &= ~termios.HUPCL
        termios.tcsetattr(self.fileno(), termios.TCSANOW, settings)
