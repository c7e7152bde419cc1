"""The thread in which a simulated device runs, at true pace.

There is no asyncio here. The thread sleeps in `poll` until the host writes or the device has something to send;
while it streams, at most `TICK_S`. What a port is, only the subclasses in `lidario.sim.serve` know.
"""

import contextlib
import errno
import selectors
import socket
import threading
import time
from abc import ABC, abstractmethod
from typing import Self

from lidario.sim.device import SimulatedDevice
from lidario.sim.faults import Faults
from lidario.sim.memory import TICK_S, MemoryLine

_IDLE_S = 0.05  # how long the thread sleeps at most, so that an unplug that is due is noticed
READ = 4096
"""Most bytes read from the client at once."""


# Not `select`, which refuses descriptors beyond 1023; a program of many devices has those. Windows has no other.
_Selector = getattr(selectors, "PollSelector", selectors.SelectSelector)


def _readable(sources: list[int | socket.socket], wait_s: float) -> list[int | socket.socket]:
    """Which of these have something to be read, when one has, or the time is up."""
    with _Selector() as selector:
        for source in sources:
            selector.register(source, selectors.EVENT_READ, source)
        return [key.data for key, _ in selector.select(wait_s)]


class Server(ABC):
    """The thread that runs the device; subclasses know the file descriptors.

    Hold `lock` while touching the device. Bytes that the client's buffer could not take are counted in `lost`.
    While the port can be opened, `plugged` is set: `replug` clears it until the new port is there.
    """

    def __init__(self, device: SimulatedDevice, faults: Faults | None, chunk: int | None) -> None:
        self.device = device
        self.lock: threading.Lock = threading.Lock()
        self.lost: int = 0
        self._faults = faults
        self._line = MemoryLine(device, faults)
        self._chunk = chunk
        self.plugged: threading.Event = threading.Event()
        self.plugged.set()
        self._error: BaseException | None = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulated device", daemon=True)

    def _begin(self) -> None:
        """Start the thread, when all else is there.

        Raises:
            OSError: The system gives no more threads, or files; nothing stays open.
        """
        with contextlib.ExitStack() as undo:
            undo.callback(self._shut)
            self._waker, self._woken = map(undo.enter_context, socket.socketpair())
            try:
                self._thread.start()
            except RuntimeError as error:
                raise OSError(errno.EAGAIN, "The system allows no more threads: see `ulimit -u`") from error
            undo.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def unplug(self) -> None:
        """Pull out the cable: the client's port dies, and nothing can be opened any more."""
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
            self.plugged.clear()
            self._shut()
            self._waker.close()
            self._woken.close()

    def _turn(self) -> bool:
        """Wait, then carry bytes both ways; False when the line is dead and stays so."""
        now = time.monotonic_ns()
        if self._faults is not None and self._faults.unplugged(now):
            back = self._faults.back_at(now)
            return back is not None and self._stay_out(back)
        with self.lock:
            wakeup = self._line.wakeup(now)
        wait = _IDLE_S if wakeup is None else min(max(TICK_S, (wakeup - now) * 1e-9), _IDLE_S)
        readable = _readable([self._woken, *self._sources()], wait)
        if self._woken in readable:
            self._woken.recv(READ)
            return not self._ending.is_set()
        received = self._receive(readable)
        with self.lock:
            now = time.monotonic_ns()
            if received:
                self._line.write(received, now)
            data = self._line.read(now)
        step = self._chunk or len(data) or 1
        for at in range(0, len(data), step):
            piece = data[at : at + step]
            self.lost += len(piece) - self._send(piece)
        return True

    def _stay_out(self, until: int) -> bool:
        """Be unplugged until then; False when the server is closed meanwhile."""
        self.plugged.clear()
        self._shut()
        while (left := until - time.monotonic_ns()) > 0 and not self._ending.is_set():
            if _readable([self._woken], left * 1e-9):
                self._woken.recv(READ)
        if self._ending.is_set():
            return False
        self._plug_in()
        self.plugged.set()
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
        """Close every file descriptor; harmless when done before."""

    @abstractmethod
    def _plug_in(self) -> None:
        """Offer a port again."""
