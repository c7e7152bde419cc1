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

Drivers differ in what they count as wrong. Those of FTDI adapters and of the serial ports of a board (as of a
Raspberry Pi) count everything. That of a CP2102 counts only where parity is checked, which no lidar has; those of
the CH340 and the PL2303 count nothing. So zeros mean little there, and any other number means the same everywhere.
"""

import contextlib
import errno
import os
import struct
import sys
import threading
from pathlib import Path

import serial

from lidario.basics.model import LineErrors
from lidario.basics.system import real_path

ROOT = Path("/")
_COUNTED = struct.Struct("=6I5I36x")
"""Linux' ``struct serial_icounter_struct``: changes of four modem lines, bytes received and sent; then framing
errors, overruns of the device, parity errors, breaks, overruns of the system's buffer; and a reserve."""
_READ_SIZE = 4096
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
        """Open exclusively, with RTS and DTR cleared; blocks. Raises one of `FOREIGN`.

        Models without a motor command run while DTR is low; pyserial would raise it and stop them.
        """
        # pyserial has one place for a write in progress, and the thread writes too (`lidario.port.thread`).
        # Reentrant: the garbage collector may have a session write its stop requests in the midst of a write.
        self._writing = threading.RLock()
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

    def read_now(self, handle: int) -> bytes:  # noqa: ARG002 - there is none
        """Return what is there, 4096 bytes at most; where the system gives no descriptor for which a loop can wait.

        Each of pyserial's calls gives the interpreter lock up some times. In a program that computes in another
        thread the lock comes back up to 5 ms later each time, so there each read takes 10 to 20 ms.

        Raises:
            BlockingIOError: Nothing is there.
            OSError: The port is dead.
        """
        # Its timeout is 0, and so is that of writing.
        data = self.read(_READ_SIZE)
        if not data:
            raise BlockingIOError
        return bytes(data)

    def write_now(self, data: bytes) -> int:
        """Likewise: return how many bytes the system took; OSError where the port is dead."""
        with self._writing:
            return int(self.write(data) or 0)

    def flush(self) -> None:
        """Do nothing: whoever closes has waited already. pyserial's own blocks until the last byte is out."""

    def close(self) -> None:
        """Close, and give back what `hurry` has set. May be called twice."""
        if self._hurried_by == os.getpid() and self.is_open:
            with contextlib.suppress(*FOREIGN):  # it is unplugged
                self.set_low_latency_mode(False)
        super().close()

    def hurry(self) -> None:
        """Have an adapter that gathers bytes send them on at once, until the port is closed. Never raises."""
        latency = latency_ms(str(self.port), ROOT)
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


def count_errors(handle: int) -> LineErrors:
    """What the driver has counted since the adapter was plugged in; zeros where it does not count.

    Raises:
        OSError: The driver cannot tell, or the port is gone.
    """
    if os.name != "posix":
        return LineErrors()
    import fcntl  # not on Windows
    import termios

    request = getattr(termios, "TIOCGICOUNT", None)
    if request is None:  # only Linux has it
        return LineErrors()
    counted = fcntl.ioctl(handle, request, bytes(_COUNTED.size))
    framing, overruns, parity, breaks, overflows = _COUNTED.unpack(counted)[6:]
    return LineErrors(framing, parity, overruns + overflows, breaks)


def latency_ms(port: str, root: Path = ROOT) -> int | None:
    """For how many milliseconds the adapter of `port` gathers bytes; None where its driver has no such timer.

    Only Linux' driver of FTDI adapters has one. It tells 1 while low latency is set.

    Args:
        port: As in ``/dev/ttyUSB0``.
        root: The folder in which ``sys`` stands.
    """
    name = os.path.basename(real_path(port))
    try:
        told = (root / "sys/class/tty" / name / "device/latency_timer").read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return None
    return int(told) if told.isdecimal() else None
