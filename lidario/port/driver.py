"""What the driver of a serial port tells: what it has counted as wrong, and how long its adapter gathers bytes.

Drivers differ. Those of FTDI adapters and of the serial ports of a board (as of a Raspberry Pi) count everything.
That of a CP2102 counts only where parity is checked, which no lidar has; those of the CH340 and the PL2303 count
nothing. So zeros mean little there, and any other number means the same everywhere.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path

from lidario.model import LineErrors

__all__ = ["count_errors", "latency_ms"]

ROOT = Path("/")
_COUNTED = struct.Struct("=6I5I36x")
"""Linux' ``struct serial_icounter_struct``: changes of four modem lines, bytes received and sent; then framing
errors, overruns of the device, parity errors, breaks, overruns of the system's buffer; and a reserve."""


def count_errors(handle: int) -> LineErrors:
    """What the driver has counted since the adapter was plugged in; zeros where it does not count.

    Args:
        handle: The descriptor of the open port.

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
    name = os.path.basename(os.path.realpath(port))
    try:
        told = (root / "sys/class/tty" / name / "device/latency_timer").read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return None
    return int(told) if told.isdecimal() else None
