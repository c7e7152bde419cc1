"""What the lines over a network have in common: how they are opened, and a socket that is written to directly.

What must be written again and again to keep a device going is written by the reading thread where the event loop
is late with it, as on a serial port (`lidario.port.repeat`). The thread has a descriptor of its own for that: the
loop may close its one at any time.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
import time
from collections.abc import Awaitable, Callable
from typing import Any, Generic, TypeVar

from lidario.errors import ConnectFailed
from lidario.port.background import run_in_thread
from lidario.port.left import wait_for_guard
from lidario.port.line import Line
from lidario.port.port import Port
from lidario.port.repeat import Repeat, Repeated
from lidario.port.thread import reading_thread

__all__ = ["SocketLine", "connected"]

T = TypeVar("T", bound=asyncio.Transport | asyncio.DatagramTransport)
_UNREACHABLE = (errno.EHOSTUNREACH, errno.ENETUNREACH)
_SAME_CLOCK_NS = 1_000_000_000
"""Two readings of one clock are less than this apart."""


async def connected(
    name: str,
    host: str,
    number: int,
    connect: Callable[[], Awaitable[object]],
    *,
    seconds: float,
    late: str,
    unreachable: str,
) -> None:
    """Await `connect`, and translate what the system says.

    Args:
        name: What is opened, for messages.
        host: Name or address.
        number: Number of the port.
        connect: Connects to them.
        seconds: How long it may take.
        late: What to say when it takes longer.
        unreachable: What to ask where there is no way to the host.

    Raises:
        ConnectFailed: It could not be done; the reason is ``refused``. Cancelling leaves nothing open.
    """
    if not 0 < number < 65536 or "\0" in host:
        # uvloop would take the number modulo 65536 and the name up to the zero byte.
        raise ConnectFailed(f"{name}: not an address that can be connected to", reason="refused")
    await run_in_thread(lambda: wait_for_guard(name))
    try:
        async with asyncio.timeout(seconds):
            await connect()
    except TimeoutError as error:
        raise ConnectFailed(f"{name}: {late}", reason="refused") from error
    except (OSError, ValueError) as error:
        # ValueError: among others the UnicodeError of a name that cannot be a host's.
        raise ConnectFailed(f"{name}: {_why(error, unreachable)}", reason="refused") from error


def _why(error: Exception, unreachable: str) -> str:
    """What the system said, and what can be done about it."""
    if not isinstance(error, OSError):
        return f"not an address that can be connected to ({error})"
    if isinstance(error, socket.gaierror):
        return f"{error.strerror}. Is the name of the host right?"
    code = error.errno or 0
    text = os.strerror(code) if code > 0 else error.strerror or str(error)
    if code == errno.ECONNREFUSED:
        return f"{text}. Is the server running, and is the port number right?"
    return f"{text}. {unreachable}" if code in _UNREACHABLE else text


class SocketLine(Line, Generic[T]):
    """asyncio's transport of a socket.

    Args:
        transport: The transport.
        port: Shows the taps what the thread has written.
    """

    def __init__(self, transport: T, port: Port) -> None:
        self._transport: T = transport
        self._port = port
        self._socket: Any = transport.get_extra_info("socket")
        self._repeater: _Repeater | None = None
        self._repeated = 0

    def is_closing(self) -> bool:
        return self._transport.is_closing()

    def descriptor(self) -> int | None:
        return int(self._socket.fileno())

    def close(self) -> None:
        self._transport.close()

    def abort(self) -> None:
        self._transport.abort()

    def set_repeat(self, request: bytes, interval: float) -> None:
        repeater, self._repeater = self._repeater, None
        if repeater is not None:
            repeater.stop()
            self._repeated += repeater.repeat.count
            self._show(repeater.repeat)
        # The thread knows the system's clock only: it is of no use to a loop with another one.
        real_time = abs(self._port.now() - time.monotonic_ns()) < _SAME_CLOCK_NS
        if request and real_time and not self._transport.is_closing():
            with contextlib.suppress(OSError):  # a connection that has just died
                self._repeater = _Repeater(self._socket.dup(), request, interval)

    @property
    def repeated(self) -> int:
        return self._repeated + (0 if self._repeater is None else self._repeater.repeat.count)

    def show_pending(self) -> None:
        if self._repeater is not None:
            self._show(self._repeater.repeat)

    def _wrote(self, data: bytes) -> None:
        """Take note of what the loop has written."""
        if self._repeater is not None and data == self._repeater.repeat.request:
            self._repeater.repeat.note()

    def _show(self, repeat: Repeat) -> None:
        for data, at in repeat.take_written():
            self._port.show("out", data, at)

    def write_without_loop(self, data: bytes) -> None:
        """As `Line.write_without_loop`; no effect under uvloop, which closes the socket with its loop."""
        with contextlib.suppress(OSError, ValueError):
            os.write(self._socket.fileno(), data)


class _Repeater:
    """Has the thread write a request to a socket.

    Args:
        own: A socket of its own for the same connection.
        request: The bytes to write.
        interval: As for `Repeat`.
    """

    def __init__(self, own: socket.socket, request: bytes, interval: float) -> None:
        self._own = own
        self.repeat: Repeat = Repeat(
            own.fileno(), request, interval, time.monotonic_ns, lambda _, data: own.send(data)
        )
        self._repeated = Repeated(self.repeat)
        try:
            reading_thread().add(self._repeated)
        except RuntimeError:
            own.close()  # the system allows no more threads: only the loop writes it
            self.repeat.stop()

    def stop(self) -> None:
        """Write it no more; a write in progress has ended when this returns."""
        self.repeat.stop()
        reading_thread().remove(self._repeated)
        self._own.close()
