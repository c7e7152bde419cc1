"""Lines over a network: a serial line that is served over TCP, and a lidar that is reached by UDP.

Their sockets are read as a terminal is. asyncio's own transports are not used: their loop reads when it gets round
to it, so that behind a blocked one everything would seem to have come late, and under uvloop a write waits until
the running callback has returned.

A datagram is a piece of the same stream as on a serial line; where datagrams end means nothing. There is no
connection: opening sends nothing, and a device that is switched off is only silent. What the system reports means
different things. A refusal says that the address is right and that nothing listens at this port: the line is lost.
An unreachable network is what a device on a direct cable leaves while it boots: the bytes are lost, and whether the
device is silent for too long is for the session to say. Lost datagrams are gaps, as damage on a serial line is.
"""

import asyncio
import contextlib
import errno
import os
import socket
import sys
from collections.abc import Sequence

from lidario.basics.system import cause_of
from lidario.errors import ConnectFailed, DeviceLost
from lidario.port.background import run_in_thread
from lidario.port.guard import wait_for_guard
from lidario.port.inbox import CONNECTION, DATAGRAMS, Kind
from lidario.port.port import Port
from lidario.port.reading import PolledLine

CONNECT_TIMEOUT_S = 5.0
BUFFER = 1 << 20
"""Bytes that the system is asked to keep until they are read; it may grant less."""
POSIX = os.name == "posix"
"""Whether each event loop can wait for a socket that another one has made."""
_UNREACHABLE = (errno.EHOSTUNREACH, errno.ENETUNREACH)
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
    known = [(name, value) for name, value in _KEEPALIVE if hasattr(socket, name)]
    options += [(socket.IPPROTO_TCP, getattr(socket, name), value) for name, value in known]
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


async def connected(
    name: str,
    host: str,
    number: int,
    kind: socket.SocketKind,
    options: Sequence[tuple[int, int, int]] = (),
    *,
    late: str,
    unreachable: str,
) -> socket.socket:
    """A socket that is connected to the first address of a host that takes it; translate what the system says.

    Before that, `options` are set: level, option and value of each. Each address has its share of
    `CONNECT_TIMEOUT_S`. Where all of it takes longer, the error says `late`; where there is no way to the host, it
    asks `unreachable`.

    Raises:
        ConnectFailed: It could not be done; the reason is ``refused``. Cancelling leaves nothing open.
    """
    if not 0 < number < 65536 or "\0" in host:
        # Some would take the number modulo 65536 and the name up to the zero byte.
        raise ConnectFailed(f"{name}: not an address that can be connected to", reason="refused")
    await run_in_thread(lambda: wait_for_guard(name))
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            *others, last = await run_in_thread(lambda: _addresses(host, kind))
            for address in others:
                # One that does not respond leaves the others their share of the time; a TimeoutError is an OSError.
                with contextlib.suppress(OSError):
                    async with asyncio.timeout(CONNECT_TIMEOUT_S / (len(others) + 1)):
                        return await connect_socket(address, number, kind, options)
            return await connect_socket(last, number, kind, options)
    except TimeoutError as error:
        raise ConnectFailed(f"{name}: {late}", reason="refused") from error
    except (OSError, ValueError) as error:
        # ValueError: among others the UnicodeError of a name that cannot be a host's.
        raise ConnectFailed(f"{name}: {_why(error, unreachable)}", reason="refused") from error


def _addresses(host: str, kind: socket.SocketKind) -> list[str]:
    """Those of a host; blocks. A loop that asks waits at its end, too, for a name server that does not respond."""
    found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    if kind is socket.SOCK_DGRAM:
        # The first one is taken: nothing tells at once that it is the wrong one. Lidars have one of IPv4.
        found.sort(key=lambda each: each[0] != socket.AF_INET)
    return [socket.getnameinfo(address, socket.NI_NUMERICHOST)[0] for *_, address in found]


async def connect_socket(
    address: str, number: int, kind: socket.SocketKind, options: Sequence[tuple[int, int, int]]
) -> socket.socket:
    """Connect to an address in figures; the socket is closed where that fails, or is cancelled."""
    made = socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET, kind)
    try:
        made.setblocking(False)
        for level, option, value in options:
            made.setsockopt(level, option, value)
        with contextlib.suppress(OSError):
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        await asyncio.get_running_loop().sock_connect(made, (address, number))
    except BaseException:
        made.close()
        raise
    return made


def is_under_way(sender: socket.socket) -> bool:
    """Whether the other end has not acknowledged all that was written; False where the system does not tell."""
    if not sys.platform.startswith("linux"):
        return False
    import fcntl  # not on Windows
    import termios

    try:
        return any(fcntl.ioctl(sender, termios.TIOCOUTQ, bytes(4)))
    except OSError:
        return False  # the connection is dead


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


class SocketLine(PolledLine):
    """A connected socket; it is read from now on."""

    def __init__(self, port: Port, connected: socket.socket, kind: Kind) -> None:
        self._socket = connected
        self._ended = False

        def receive(_: int) -> bytes:
            data = connected.recv(kind.size)
            if not data and kind.more:
                raise OSError(kind.ended)
            return data

        handle, read = (connected.fileno(), None) if POSIX else (-1, receive)
        super().__init__(asyncio.get_running_loop(), port, handle, connected.send, read, kind)
        self.start()

    def passed_on(self) -> tuple[int, bool] | None:
        handle = self._socket.fileno()
        return None if handle < 0 else (handle, False)

    def write(self, data: bytes) -> None:
        self._write_some(data)

    def write_without_loop(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self._socket.send(data)

    def close(self) -> None:
        self.abort()

    def abort(self) -> None:
        self.stop()
        self._loop.call_soon(self._end)

    def close_without_loop(self) -> None:
        self.is_closing = self._ended = True
        self.release()
        self._socket.close()

    def _end(self) -> None:
        if not self._ended:
            self._ended = True
            self._socket.close()
            self.hand_over()
            self._port.connection_lost(self._error)


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
        if self._unsent:
            self._unsent = self._write_some(self._unsent)
        if self._unsent or (self.is_closing and is_under_way(self._socket)):
            self._loop.call_later(_AGAIN_S, self._send)
        elif self.is_closing:
            self.abort()

    def close(self) -> None:
        # If the device sends on after the socket is closed, the system answers with a reset, and drops what the
        # other end has not acknowledged. So it is closed after that; `Port.close_soon` bounds the time.
        self.stop()
        if not self._unsent:
            self._send()

    def close_without_loop(self) -> None:
        # Also where another process has the socket, too: the other end is told.
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        super().close_without_loop()


class _UdpLine(SocketLine):
    """A connected UDP socket, of which the system tells what became of an earlier datagram."""

    def lose(self, error: Exception) -> None:
        # Windows calls a refusal a reset.
        if isinstance(error, ConnectionError):
            text = f"{self._port.name} is gone: nothing listens at this UDP port. Are address and port right?"
            why = DeviceLost(text)
            why.__cause__ = error
            super().lose(why)
