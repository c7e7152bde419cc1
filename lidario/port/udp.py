"""A lidar that is reached by UDP, as Ethernet models are: its serial byte stream, in datagrams.

A datagram is a piece of the same stream as on a serial line; where datagrams end means nothing. There is no
connection: opening sends nothing, and a device that is switched off is only silent. What the system reports means
different things. A refusal says that the address is right and that nothing listens at this port: the line is lost.
An unreachable network is what a device on a direct cable leaves while it boots: the bytes are lost, and whether the
device is silent for too long is for the session to say. Lost datagrams are gaps, as damage on a serial line is.

Writes do not wait for the transport: uvloop writes only when the running callback has returned. And what waits is
read at once, as of a terminal: behind a blocked loop each datagram would seem to have come when it was read, and a
device that went on all the time to have been silent.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import Iterator
from typing import Any, cast

from lidario.errors import DeviceLost
from lidario.port.line import Line
from lidario.port.port import Port
from lidario.port.sockets import BUFFER, SocketLine, connected

RESOLVE_TIMEOUT_S = 5.0
MOST_DATAGRAMS = 4096
"""Read at once, at most, and 256 KiB, as by TCP: four seconds of the fastest stream."""
_LONGEST = 1 << 16


async def open_udp(name: str, host: str, number: int) -> Port:
    """Open a line to a lidar in the network; nothing is sent.

    Raises:
        ConnectFailed: Unknown host, impossible address, or no way to it. Cancelling leaves nothing open.
    """
    loop = asyncio.get_running_loop()
    port = _UdpPort(name)
    await connected(
        name,
        host,
        number,
        lambda address: loop.create_datagram_endpoint(lambda: port, remote_addr=(address, number)),
        seconds=RESOLVE_TIMEOUT_S,
        late=f"the name was not resolved within {RESOLVE_TIMEOUT_S:g} s. Is the name of the host right?",
        unreachable="Is this computer in the network of the lidar?",
    )
    return port


class _UdpPort(Port, asyncio.DatagramProtocol):
    """A port that makes its line when the socket is there."""

    def connection_made(self, transport: asyncio.BaseTransport | Line) -> None:
        super().connection_made(_UdpLine(cast("asyncio.DatagramTransport", transport), self))

    def datagram_received(self, data: bytes, addr: Any) -> None:  # noqa: ARG002
        line = self._line
        if isinstance(line, _UdpLine) and not self.is_forked:
            data = b"".join((data, *line.waiting()))
        if data:
            self.data_received(data)

    def error_received(self, exc: Exception) -> None:
        if isinstance(self._line, _UdpLine):
            self._line.failed(exc)


class _UdpLine(SocketLine[asyncio.DatagramTransport]):
    """asyncio's transport of a connected UDP socket."""

    def __init__(self, transport: asyncio.DatagramTransport, port: Port) -> None:
        super().__init__(transport, port)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)

    def waiting(self) -> Iterator[bytes]:
        """The datagrams that wait to be read, as of now."""
        if os.name != "posix":
            return
        count = size = 0
        try:
            while count < MOST_DATAGRAMS and size < BUFFER // 4:
                data = os.read(self._socket.fileno(), _LONGEST)
                count, size = count + 1, size + len(data)
                yield data
        except BlockingIOError:
            pass
        except OSError as error:
            self.failed(error)

    def failed(self, error: Exception) -> None:
        """The system reports an error of an earlier datagram."""
        # Windows calls a refusal a reset.
        if isinstance(error, ConnectionError) and not self._transport.is_closing():
            why = DeviceLost(
                f"{self._port.name} is gone: nothing listens at this UDP port. Are address and port right?"
            )
            why.__cause__ = error
            self._port.explain_loss = lambda: why
            self._transport.abort()

    def write(self, data: bytes) -> None:
        if os.name != "posix":
            self._transport.sendto(data)
            return
        try:
            os.write(self._socket.fileno(), data)
        except BlockingIOError:
            self._transport.sendto(data)
        except OSError as error:
            self.failed(error)

    def close_without_loop(self) -> None:
        """Nobody has to be told; the socket is closed with the loop, or by the garbage collector."""
