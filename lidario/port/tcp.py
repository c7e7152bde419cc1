"""A serial line that is served over TCP, as by a serial-to-network bridge.

asyncio's own transport carries the bytes. Writes do not wait for it: uvloop writes only when the running callback
has returned, so the socket is written to directly while nothing is pending before. Keepalive is on, since a bridge
that loses its power cannot close the connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
from typing import Any, cast

from lidario.errors import ConnectFailed
from lidario.port.line import Line
from lidario.port.port import Port

__all__ = ["open_tcp"]

CONNECT_TIMEOUT_S = 5.0
_KEEPALIVE = (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 2), ("TCP_KEEPCNT", 3))
"""Seconds of silence before the first probe, between two, and how many may fail: a dead bridge is seen in 11 s."""


async def open_tcp(name: str, host: str, number: int, baudrate: int = 0) -> Port:
    """Connect to a serial line that is served over TCP.

    Args:
        name: What is opened, for messages.
        host: Name or address.
        number: Number of the TCP port.
        baudrate: Speed of the serial line behind it, in bits a second; 0 when unknown.

    Raises:
        ConnectFailed: Unknown host, refused, impossible address, or no response within five seconds. Cancelling
            leaves nothing open.
    """
    if not 0 < number < 65536 or "\0" in host:
        # uvloop would take the number modulo 65536 and the name up to the zero byte.
        raise ConnectFailed(f"{name}: not an address that can be connected to", reason="refused")
    loop = asyncio.get_running_loop()
    port = _TcpPort(name, baudrate)
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            await loop.create_connection(lambda: port, host, number)
    except TimeoutError as error:
        text = f"{name}: no response within {CONNECT_TIMEOUT_S:g} s. Is it switched on, and in this network?"
        raise ConnectFailed(text, reason="refused") from error
    except (OSError, ValueError) as error:
        # ValueError: among others the UnicodeError of a name that cannot be a host's.
        raise ConnectFailed(f"{name}: {_why(error)}", reason="refused") from error
    return port


def _why(error: Exception) -> str:
    """What the system said, and what can be done about it."""
    if not isinstance(error, OSError):
        return f"not an address that can be connected to ({error})"
    if isinstance(error, socket.gaierror):
        return f"{error.strerror}. Is the name of the host right?"
    code = error.errno or 0
    text = os.strerror(code) if code > 0 else error.strerror or str(error)
    if code == errno.ECONNREFUSED:
        return f"{text}. Is the server running, and is the port number right?"
    if code in (errno.EHOSTUNREACH, errno.ENETUNREACH):
        return f"{text}. Is it switched on, and in this network?"
    return text


class _TcpPort(Port):
    """A port that makes its line when the connection stands."""

    def connection_made(self, transport: asyncio.BaseTransport | Line) -> None:
        # Not isinstance: uvloop's transports are no subclasses of asyncio.Transport.
        super().connection_made(_TcpLine(cast("asyncio.Transport", transport)))


class _TcpLine(Line):
    """asyncio's transport of a TCP connection."""

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self._socket: Any = transport.get_extra_info("socket")
        # A connection that is already dead refuses options; its end is told by the transport.
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option, value in _KEEPALIVE:
                if hasattr(socket, option):
                    self._socket.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    def is_closing(self) -> bool:
        return self._transport.is_closing()

    def write(self, data: bytes) -> None:
        if os.name == "posix" and not self._transport.get_write_buffer_size():
            # An error is left to the transport, which meets it too and ends the connection.
            with contextlib.suppress(OSError):
                data = data[os.write(self._socket.fileno(), data) :]
        if data:
            self._transport.write(data)

    def close(self) -> None:
        self._transport.close()

    def abort(self) -> None:
        self._transport.abort()

    def write_without_loop(self, data: bytes) -> None:
        # Has no effect under uvloop once its loop is closed, since that closes the socket.
        with contextlib.suppress(OSError, ValueError):
            os.write(self._socket.fileno(), data)

    def close_without_loop(self) -> None:
        # asyncio closes the socket with its loop, or the garbage collector does. Only the other end is still to be
        # told.
        with contextlib.suppress(OSError, ValueError, TypeError):
            self._socket.shutdown(socket.SHUT_RDWR)
