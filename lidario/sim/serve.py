"""Serving a simulated device: in memory, on a pseudo-terminal, over TCP.

`MemoryLine` has no clock: the caller passes the time, thousands of revolutions per second if it wants.
`PtyServer` and `TcpServer` run the device at true pace in a daemon thread of their own, so that any program
can open it: ours, another process, another vendor's driver. There is no asyncio here. The thread waits in
`select` until the host writes or the device has something to send; while it streams, at most `tick`.

The line loses bytes as a real one does. What the terminal's or socket's buffer cannot take is lost, as on
a UART, and is counted in `lost`. While no TCP client is connected the bytes go nowhere. `unplug` is the
cable pulled out: the client's port dies. An exception of the simulated device is kept and raised by
`close`, so that it does not get lost in a thread.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import threading
import time
from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from lidario.sim.device import SimulatedDevice
from lidario.sim.faults import Faults

__all__ = ["MemoryLine", "PtyServer", "TcpServer"]

_IDLE_S = 0.05  # how long the thread sleeps at most, so that an unplug that is due is noticed
_READ = 4096


class MemoryLine:
    """A line without a clock and without a thread, for tests, benchmarks and simulated sources.

    Args:
        device: The device at the other end.
        faults: What happens to its bytes on the way.
    """

    def __init__(self, device: SimulatedDevice, faults: Faults | None = None) -> None:
        self.device = device
        self._faults = faults

    def write(self, data: bytes, now: int) -> None:
        """The host's bytes arrive at the device at `now`."""
        self.device.receive(data, now)

    def read(self, now: int) -> bytes:
        """What has arrived at the host since the last call."""
        data = self.device.transmit(now)
        return data if self._faults is None else self._faults.apply(data, now)

    def wakeup(self, now: int) -> int | None:
        """When `read` will next return something; None while nothing is under way."""
        return self.device.wakeup(now)

    def unplugged(self, now: int) -> bool:
        """Whether the faults have unplugged the line by `now`."""
        return self._faults is not None and self._faults.unplugged(now)


class _Server(ABC):
    """The thread that runs the device; subclasses know the file descriptors.

    Attributes:
        device: The device; hold `lock` while touching it.
        lock: Taken by the thread whenever it is inside of the device.
        lost: Bytes that the client's buffer could not take.
    """

    def __init__(self, device: SimulatedDevice, tick: float, faults: Faults | None, chunk: int | None) -> None:
        if tick <= 0.0 or (chunk is not None and chunk <= 0):
            raise ValueError("tick and chunk must be positive")
        self.device = device
        self.lock: threading.Lock = threading.Lock()
        self.lost: int = 0
        self._tick = tick
        self._faults = faults
        self._chunk = chunk
        self._error: BaseException | None = None
        self._ending = threading.Event()
        self._waker, self._woken = socket.socketpair()
        self._thread = threading.Thread(target=self._run, name="simulated device", daemon=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def unplug(self) -> None:
        """Pull the cable out: the client's port dies, and nothing can be opened any more."""
        self._ending.set()
        with contextlib.suppress(OSError):
            self._waker.send(b"\0")
        if self._thread is not threading.current_thread():
            self._thread.join()

    def close(self) -> None:
        """Stop serving and wait for the thread; harmless when done before.

        Raises:
            RuntimeError: The simulated device raised an exception, which is the cause.
        """
        self.unplug()
        error, self._error = self._error, None
        if error is not None:
            raise RuntimeError("the simulated device failed") from error

    @property
    def unplugged(self) -> bool:
        """Whether the line is dead: `unplug`, `close`, or a fault did it."""
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            while not self._ending.is_set() and self._turn():
                pass
        except Exception as error:
            self._error = error
        finally:
            self._shut()
            self._waker.close()
            self._woken.close()

    def _turn(self) -> bool:
        """Wait, then carry bytes both ways; False when a fault has unplugged the line."""
        now = time.monotonic_ns()
        if self._faults is not None and self._faults.unplugged(now):
            return False
        with self.lock:
            wakeup = self.device.wakeup(now)
        wait = _IDLE_S if wakeup is None else min(max(self._tick, (wakeup - now) * 1e-9), _IDLE_S)
        if self._faults is not None and self._faults.holding:
            wait = self._tick
        readable, _, _ = select.select([self._woken, *self._sources()], [], [], wait)
        if self._woken in readable:
            return False
        received = self._receive(readable)
        with self.lock:
            now = time.monotonic_ns()
            if received:
                self.device.receive(received, now)
            data = self.device.transmit(now)
        if self._faults is not None:
            data = self._faults.apply(data, now)
        step = self._chunk or len(data) or 1
        for at in range(0, len(data), step):
            piece = data[at : at + step]
            self.lost += len(piece) - self._send(piece)
        return True

    @abstractmethod
    def _sources(self) -> list[int | socket.socket]:
        """What to wait for besides the clock."""

    @abstractmethod
    def _receive(self, readable: list[int | socket.socket]) -> bytes:
        """What the client has written."""

    @abstractmethod
    def _send(self, data: bytes) -> int:
        """Hand bytes to the client; returns how many it could take."""

    @abstractmethod
    def _shut(self) -> None:
        """Close every file descriptor."""


class PtyServer(_Server):
    """A simulated device on a pseudo-terminal (not on Windows); clients may come and go.

    Args:
        device: The device.
        tick: Seconds between two polls of a device that is sending.
        faults: What happens to its bytes on the way.
        chunk: Most bytes written at once, such as the 64 of a USB adapter; None = all there are.

    Attributes:
        path: What to open.

    Raises:
        OSError: The system has no pseudo-terminals, or none left.
    """

    def __init__(
        self,
        device: SimulatedDevice,
        *,
        tick: float = 0.002,
        faults: Faults | None = None,
        chunk: int | None = None,
    ) -> None:
        if sys.platform == "win32":
            raise OSError("this system has no pseudo-terminals; serve the device over TCP")
        import tty

        super().__init__(device, tick, faults, chunk)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path: str = os.ttyname(self._slave)
        self._thread.start()

    def _sources(self) -> list[int | socket.socket]:
        return [self._master]

    def _receive(self, readable: list[int | socket.socket]) -> bytes:
        return os.read(self._master, _READ) if self._master in readable else b""

    def _send(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def _shut(self) -> None:
        os.close(self._master)
        os.close(self._slave)


class TcpServer(_Server):
    """A simulated device behind a TCP port, as a serial-to-network bridge offers it: one client at a time.

    Args:
        device: The device.
        host: Address to listen on.
        port: Port to listen on; 0 = any free one.
        tick: Seconds between two polls of a device that is sending.
        faults: What happens to its bytes on the way.
        chunk: Most bytes sent at once; None = all there are.

    Attributes:
        address: Host and port that it listens on.

    Raises:
        OSError: The address cannot be listened on.
    """

    def __init__(
        self,
        device: SimulatedDevice,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        tick: float = 0.002,
        faults: Faults | None = None,
        chunk: int | None = None,
    ) -> None:
        listener = socket.create_server((host, port), backlog=1)
        try:
            super().__init__(device, tick, faults, chunk)
        except BaseException:
            listener.close()
            raise
        listener.setblocking(False)
        self._listener = listener
        self._client: socket.socket | None = None
        bound = listener.getsockname()
        self.address: tuple[str, int] = (bound[0], bound[1])
        self._thread.start()

    def _sources(self) -> list[int | socket.socket]:
        return [self._listener] if self._client is None else [self._listener, self._client]

    def _receive(self, readable: list[int | socket.socket]) -> bytes:
        # The old client first: if it has closed its end, the next one can be accepted at once.
        data = self._hear(self._client)
        if self._listener in readable:
            self._accept()
        return data

    def _hear(self, client: socket.socket | None) -> bytes:
        """All that the client has sent; notices when it has closed its end, too."""
        parts: list[bytes] = []
        while client is not None and len(parts) < 64:
            try:
                part = client.recv(_READ)
            except BlockingIOError:
                break
            except OSError:
                part = b""
            if not part:
                self._hang_up()
                break
            parts.append(part)
        return b"".join(parts)

    def _accept(self) -> None:
        """Accept a client; while there is one, others are refused."""
        try:
            client, _ = self._listener.accept()
        except OSError:
            return  # it closed its end before it was accepted
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

    def _shut(self) -> None:
        self._hang_up()
        self._listener.close()
