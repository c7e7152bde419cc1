"""Serving a simulated device on a pseudo-terminal, over TCP or by UDP, at true pace in a daemon thread of its own.

What the terminal's or socket's buffer cannot take is lost, as on a UART, and is counted in `lost`. While there is
no client the bytes go nowhere. `unplug` is the cable pulled out: the client's port dies. The fault ``replug`` puts
it in again; as on a real system, the new port may have another name.
"""

import os
import socket
import sys

from lidario.sim.device import SimulatedDevice
from lidario.sim.faults import Faults
from lidario.sim.memory import TICK_S
from lidario.sim.server import READ, Server


def usual_way(device: SimulatedDevice) -> str:
    """How a device is served unless the user says it: ``"udp"`` for a network device; else ``"pty"`` or ``"tcp"``.

    ``"pty"`` on Linux, ``"tcp"`` elsewhere: Windows has no pseudo-terminals. On macOS they take the speeds of POSIX
    alone; pyserial sets another one, such as 256000 or 1000000, by an ioctl of serial adapters, which a
    pseudo-terminal refuses (ENOTTY).
    """
    if getattr(device, "is_network", False):
        return "udp"
    return "pty" if sys.platform == "linux" else "tcp"


class PtyServer(Server):
    """A simulated device on a pseudo-terminal (not on Windows); clients may come and go.

    Clients open `path`, which is another one after a replug. At most a `chunk` is written at once, such as the 64
    bytes of a USB adapter.

    Raises:
        OSError: The system has no pseudo-terminals, or none left.
    """

    def __init__(self, device: SimulatedDevice, *, faults: Faults | None = None, chunk: int | None = None) -> None:
        if sys.platform == "win32":
            raise OSError("this system has no pseudo-terminals; serve the device over TCP")
        super().__init__(device, faults, chunk)
        self._held = -1
        self._plug_in()
        try:
            self._begin()
        except BaseException:
            self._let_go()
            raise

    def _sources(self) -> list[int | socket.socket]:
        return [self._master]

    def _receive(self, readable: list[int | socket.socket]) -> bytes:
        return os.read(self._master, READ) if self._master in readable else b""

    def _send(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def _plug_in(self) -> None:
        import tty

        with self.lock:
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self.path: str = os.ttyname(self._slave)

    def _shut(self) -> None:
        with self.lock:
            if self._master < 0:
                return  # the cable is out
            os.close(self._master)
            # The system gives a free name to the next one who asks, and a client that tries to come back would
            # write to that terminal. As long as this end is open, the name is gone, and is not free.
            self._let_go()
            self._master, self._slave, self._held = -1, -1, self._slave

    def close(self) -> None:
        """Stop serving; then the name of the port is free again. Harmless when done before."""
        try:
            super().close()
        finally:
            with self.lock:
                self._let_go()

    def _let_go(self) -> None:
        held, self._held = self._held, -1
        if held >= 0:
            os.close(held)


class _AddressServer(Server):
    """One that is reached at an `address` of this machine, host and port; port 0 = any free one.

    Raises:
        OSError: The address cannot be listened on.
    """

    _most: int | None = None
    """Most bytes that are sent at once; None = all there are."""
    _socket: socket.socket
    """What clients find at the address; `_plug_in` opens it."""

    def __init__(
        self, device: SimulatedDevice, host: str = "127.0.0.1", port: int = 0, *, faults: Faults | None = None
    ) -> None:
        self.address: tuple[str, int] = (host, port)
        super().__init__(device, faults, self._most)
        self._plug_in()
        bound = self._socket.getsockname()
        self.address = (bound[0], bound[1])
        self._begin()


class TcpServer(_AddressServer):
    """A simulated device behind a TCP port, as a serial-to-network bridge offers it: one client at a time."""

    _client: socket.socket | None = None

    def _sources(self) -> list[int | socket.socket]:
        return [self._socket] if self._client is None else [self._socket, self._client]

    def _receive(self, readable: list[int | socket.socket]) -> bytes:
        parts: list[bytes] = []
        # The old client first: if it has closed its end, the next one can be accepted at once.
        while self._client is not None and len(parts) < 64:
            try:
                parts.append(self._client.recv(READ))
            except BlockingIOError:
                break
            except OSError:
                self._hang_up()
                break
            if not parts[-1]:
                self._hang_up()
        if self._socket in readable:
            self._accept()
        return b"".join(parts)

    def _accept(self) -> None:
        """Accept a client; while there is one, others are refused."""
        try:
            client, _ = self._socket.accept()
        except OSError:
            # It closed its end before that, or no descriptor is left: then the system tells of it at once again.
            self._ending.wait(TICK_S)
            return
        if self._client is not None:
            client.close()
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client

    def _send(self, data: bytes) -> int:
        if self._client is None:
            return len(data)
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._hang_up()
            return 0

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def _plug_in(self) -> None:
        self._socket = socket.create_server(self.address, family=_family(self.address), backlog=1)
        self._socket.setblocking(False)

    def _shut(self) -> None:
        self._hang_up()
        self._socket.close()


class UdpServer(_AddressServer):
    """A simulated Ethernet device over UDP. It responds to the program that wrote to it last."""

    _most = 1024
    """Of a datagram: the vendor's driver reads so many of each."""
    _peer: tuple[str, int] | None = None

    def _sources(self) -> list[int | socket.socket]:
        return [self._socket]

    def _receive(self, readable: list[int | socket.socket]) -> bytes:
        if self._socket not in readable:
            return b""
        try:
            data, self._peer = self._socket.recvfrom(READ)
        except OSError:
            return b""  # an earlier datagram was refused: the client is gone
        return data

    def _send(self, data: bytes) -> int:
        if self._peer is None:
            return len(data)
        try:
            return self._socket.sendto(data, self._peer)
        except OSError:
            return 0

    def _plug_in(self) -> None:
        self._socket = socket.socket(_family(self.address), socket.SOCK_DGRAM)
        try:
            self._socket.bind(self.address)
        except BaseException:
            self._socket.close()
            raise
        self._socket.setblocking(False)

    def _shut(self) -> None:
        self._socket.close()


def _family(address: tuple[str, int]) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in address[0] else socket.AF_INET
