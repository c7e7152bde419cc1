"""A lidar that is reached by UDP, as Ethernet models are: its serial byte stream, in datagrams.

A datagram is a piece of the same stream as on a serial line; where datagrams end means nothing. There is no
connection: opening sends nothing, and a device that is switched off is only silent. What the system reports means
different things. A refusal says that the address is right and that nothing listens at this port: the line is lost.
An unreachable network is what a device on a direct cable leaves while it boots: the bytes are lost, and whether the
device is silent for too long is for the session to say. Lost datagrams are gaps, as damage on a serial line is.
"""

from __future__ import annotations

import socket

from lidario.errors import DeviceLost
from lidario.port.inbox import DATAGRAMS
from lidario.port.port import Port
from lidario.port.sockets import CONNECT_TIMEOUT_S, SocketLine, connected


async def open_udp(name: str, host: str, number: int) -> Port:
    """Open a line to a lidar in the network; nothing is sent.

    Raises:
        ConnectFailed: Unknown host, impossible address, or no way to it. Cancelling leaves nothing open.
    """
    made = await connected(
        name,
        host,
        number,
        socket.SOCK_DGRAM,
        late=f"the name was not resolved within {CONNECT_TIMEOUT_S:g} s. Is the name of the host right?",
        unreachable="Is this computer in the network of the lidar?",
    )
    port = Port(name)
    port.connection_made(_UdpLine(port, made, DATAGRAMS))
    return port


class _UdpLine(SocketLine):
    """A connected UDP socket, of which the system tells what became of an earlier datagram."""

    def lose(self, error: Exception) -> None:
        # Windows calls a refusal a reset.
        if isinstance(error, ConnectionError):
            text = f"{self._port.name} is gone: nothing listens at this UDP port. Are address and port right?"
            why = DeviceLost(text)
            why.__cause__ = error
            super().lose(why)
