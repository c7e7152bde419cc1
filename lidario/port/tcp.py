"""A serial line that is served over TCP, as by a serial-to-network bridge.

Keepalive is on, since a bridge that loses its power cannot close the connection.
"""

from __future__ import annotations

import contextlib
import socket

from lidario.port.inbox import CONNECTION
from lidario.port.port import Port
from lidario.port.sockets import CONNECT_TIMEOUT_S, SocketLine, connected

_KEEPALIVE = (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 2), ("TCP_KEEPCNT", 3), ("TCP_USER_TIMEOUT", 11_000))
"""Seconds of silence before the first probe, between two, and how many may fail: a dead bridge is seen in 11 s.
Likewise, in milliseconds, where what was written is not acknowledged: no probe is sent then, and the system would
try for a quarter of an hour to deliver it, a STOP of a closed connection too."""
_AGAIN_S = 0.005
"""After that time it is tried again to write what the system did not take."""


async def open_tcp(name: str, host: str, number: int, baudrate: int = 0) -> Port:
    """Connect to a serial line that is served over TCP.

    Raises:
        ConnectFailed: Unknown host, refused, impossible address, or no response within five seconds. Cancelling
            leaves nothing open.
    """
    options = [(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1), (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)]
    for option, value in _KEEPALIVE:
        if hasattr(socket, option):
            options.append((socket.IPPROTO_TCP, getattr(socket, option), value))
    made = await connected(
        name,
        host,
        number,
        socket.SOCK_STREAM,
        options,
        late=f"no response within {CONNECT_TIMEOUT_S:g} s. Is it switched on, and in this network?",
        unreachable="Is it switched on, and in this network?",
    )
    port = Port(name, baudrate)
    port.likely_loss = "Was it switched off, or does it take one connection, and another program has it now?"
    port.connection_made(_TcpLine(port, made, CONNECTION))
    return port


class _TcpLine(SocketLine):
    """A TCP connection, which takes what is written when its peer has read what was written before."""

    _unsent = b""

    def write(self, data: bytes) -> None:
        self._unsent += data
        if len(self._unsent) == len(data):
            self._send()

    def _send(self) -> None:
        if self._ended or self._port.is_forked:
            return
        self._unsent = self._write_some(self._unsent)
        if self._unsent:
            self._loop.call_later(_AGAIN_S, self._send)
        elif self.is_closing:
            self.abort()

    def close(self) -> None:
        if self._unsent:
            self.stop()
        else:
            super().close()

    def close_without_loop(self) -> None:
        # Also where another process has the socket, too: the other end is told.
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        super().close_without_loop()
