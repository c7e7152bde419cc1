"""A serial line that is served over TCP, as by a serial-to-network bridge.

asyncio's own transport carries the bytes. Writes do not wait for it: uvloop writes only when the running callback
has returned, so the socket is written to directly while nothing is pending before. Keepalive is on, since a bridge
that loses its power cannot close the connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from typing import cast

from lidario.port.line import Line
from lidario.port.port import Port
from lidario.port.sockets import BUFFER, SocketLine, connected

CONNECT_TIMEOUT_S = 5.0
_KEEPALIVE = (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 2), ("TCP_KEEPCNT", 3))
"""Seconds of silence before the first probe, between two, and how many may fail: a dead bridge is seen in 11 s."""


async def open_tcp(name: str, host: str, number: int, baudrate: int = 0) -> Port:
    """Connect to a serial line that is served over TCP.

    Raises:
        ConnectFailed: Unknown host, refused, impossible address, or no response within five seconds. Cancelling
            leaves nothing open.
    """
    loop = asyncio.get_running_loop()
    port = _TcpPort(name, baudrate)
    await connected(
        name,
        host,
        number,
        lambda address: loop.create_connection(lambda: port, address, number),
        seconds=CONNECT_TIMEOUT_S,
        late=f"no response within {CONNECT_TIMEOUT_S:g} s. Is it switched on, and in this network?",
        unreachable="Is it switched on, and in this network?",
    )
    return port


class _TcpPort(Port):
    """A port that makes its line when the connection stands."""

    likely_loss = "Was it switched off, or does it take one connection, and another program has it now?"

    def connection_made(self, transport: asyncio.BaseTransport | Line) -> None:
        # Not isinstance: uvloop's transports are no subclasses of asyncio.Transport.
        super().connection_made(_TcpLine(cast("asyncio.Transport", transport), self))


class _TcpLine(SocketLine[asyncio.Transport]):
    """asyncio's transport of a TCP connection."""

    def __init__(self, transport: asyncio.Transport, port: Port) -> None:
        super().__init__(transport, port)
        # A connection that is already dead refuses options; its end is told by the transport.
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            for option, value in _KEEPALIVE:
                if hasattr(socket, option):
                    self._socket.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    def write(self, data: bytes) -> None:
        if os.name == "posix" and not self._transport.get_write_buffer_size():
            # An error is left to the transport, which meets it too and ends the connection.
            with contextlib.suppress(OSError):
                data = data[os.write(self._socket.fileno(), data) :]
        if data:
            self._transport.write(data)

    def close_without_loop(self) -> None:
        # asyncio closes the socket with its loop, or the garbage collector does. Only the other end is still to be
        # told.
        with contextlib.suppress(OSError, ValueError, TypeError):
            self._socket.shutdown(socket.SHUT_RDWR)
