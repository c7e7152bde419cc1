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
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Generic, TypeVar

from lidario.errors import ConnectFailed
from lidario.port.background import run_in_thread
from lidario.port.guard import wait_for_guard
from lidario.port.line import Line
from lidario.port.port import Port
from lidario.port.repeat import Repeat
from lidario.system import cause_of

T = TypeVar("T", bound=asyncio.Transport | asyncio.DatagramTransport)
BUFFER = 1 << 20
"""Bytes that the system is asked to keep while the program blocks its event loop; it may grant less."""
_UNREACHABLE = (errno.EHOSTUNREACH, errno.ENETUNREACH)


async def connected(
    name: str,
    host: str,
    number: int,
    connect: Callable[[str], Awaitable[object]],
    *,
    seconds: float,
    late: str,
    unreachable: str,
) -> None:
    """Await `connect` to an address of a host, the first one that takes it, and translate what the system says.

    Each address has its share of so many seconds. Where all of it takes longer, the error says `late`; where there
    is no way to the host, it asks `unreachable`.

    Raises:
        ConnectFailed: It could not be done; the reason is ``refused``. Cancelling leaves nothing open.
    """
    if not 0 < number < 65536 or "\0" in host:
        # uvloop would take the number modulo 65536 and the name up to the zero byte.
        raise ConnectFailed(f"{name}: not an address that can be connected to", reason="refused")
    await run_in_thread(lambda: wait_for_guard(name))
    try:
        async with asyncio.timeout(seconds):
            await _first(await run_in_thread(lambda: _addresses(host)), connect, seconds)
    except TimeoutError as error:
        raise ConnectFailed(f"{name}: {late}", reason="refused") from error
    except (OSError, ValueError) as error:
        # ValueError: among others the UnicodeError of a name that cannot be a host's.
        raise ConnectFailed(f"{name}: {_why(error, unreachable)}", reason="refused") from error


def _addresses(host: str) -> list[str]:
    """Those of a host; blocks. A loop that asks waits at its end, too, for a name server that does not respond."""
    found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    return [socket.getnameinfo(address, socket.NI_NUMERICHOST)[0] for *_, address in found]


async def _first(addresses: Sequence[str], connect: Callable[[str], Awaitable[object]], seconds: float) -> None:
    *others, last = addresses
    for address in others:
        # One that does not respond leaves the others their share of the time; a TimeoutError is an OSError.
        with contextlib.suppress(OSError):
            async with asyncio.timeout(seconds / len(addresses)):
                await connect(address)
            return
    await connect(last)


def _why(error: Exception, unreachable: str) -> str:
    """What the system said, and what can be done about it."""
    if not isinstance(error, OSError):
        return f"not an address that can be connected to ({error})"
    if isinstance(error, socket.gaierror):
        return f"{error.strerror}. Is the name of the host right?"
    code = error.errno
    text = cause_of(OSError(code, os.strerror(code))) if code else str(error)
    if code == errno.ECONNREFUSED:
        return f"{text}. Is the server running, and is the port number right?"
    return f"{text}. {unreachable}" if code in _UNREACHABLE else text


class SocketLine(Line, Generic[T]):
    """asyncio's transport of a socket."""

    def __init__(self, transport: T, port: Port) -> None:
        self._transport: T = transport
        self._port = port
        self._socket: Any = transport.get_extra_info("socket")
        if port.is_real_time:
            self.repeat: Repeat | None = _SocketRepeat(self._socket)

    def is_closing(self) -> bool:
        return self._transport.is_closing()

    def passed_on(self) -> tuple[int, bool] | None:
        handle = int(self._socket.fileno())
        return None if handle < 0 else (handle, False)

    def let_go(self) -> None:
        super().let_go()
        if isinstance(self.repeat, _SocketRepeat):
            self.repeat.let_go()

    def close(self) -> None:
        self._transport.close()

    def abort(self) -> None:
        self._transport.abort()

    def write_without_loop(self, data: bytes) -> None:
        """As `Line.write_without_loop`; no effect under uvloop, which closes the socket with its loop."""
        with contextlib.suppress(OSError, ValueError):
            os.write(self._socket.fileno(), data)


class _SocketRepeat(Repeat):
    """Writes to a descriptor of its own, which is open only meanwhile."""

    def __init__(self, line: Any) -> None:
        super().__init__(self._send)
        self._line = line
        self._own: socket.socket | None = None

    def set(self, request: bytes, interval: float) -> None:
        super().set(b"", 0.0)
        self.let_go()
        if request:
            with contextlib.suppress(OSError):  # a connection that has just died
                self._own = self._line.dup()
                super().set(request, interval)

    def let_go(self) -> None:
        if self._own is not None:
            self._own.close()
            self._own = None

    def _send(self, data: bytes) -> None:
        if self._own is not None:
            self._own.send(data)
