"""What tests of the port share: receivers that keep everything, a schedule, and a pseudo-terminal."""

import asyncio
import inspect
import os
import select
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import replace
from functools import wraps
from types import ModuleType
from typing import Any, TypeVar

import pytest

from lidario.errors import DeviceLost
from lidario.families.registry import FAMILIES
from lidario.port.port import Port
from lidario.port.reading import PolledLine
from lidario.port.serial import open_serial

PATIENCE_S = 20.0
T = TypeVar("T")
LIBRARIES: list[ModuleType] = [asyncio]
if sys.platform != "win32":
    import uvloop

    LIBRARIES.append(uvloop)
both_loops = pytest.mark.parametrize("library", LIBRARIES, ids=lambda library: library.__name__)


def on_both_loops(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Decorate an async test to run on the event loop of each library."""

    def on_each(library: ModuleType, **values: Any) -> None:
        run_on(library, lambda: test(**values))

    own = inspect.Parameter("library", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    wraps(test)(on_each)
    on_each.__signature__ = inspect.Signature([own, *inspect.signature(test).parameters.values()])  # type: ignore[attr-defined]
    decorated: Callable[..., None] = both_loops(on_each)
    return decorated


def run_on(library: ModuleType, main: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a program on the event loop of that library."""
    with asyncio.Runner(loop_factory=library.new_event_loop) as runner:
        return runner.run(main())


class OnlyRead(PolledLine):
    """A descriptor that is read as a serial port is, and what it was lost by; nothing is written."""

    def __init__(self, port: Port, handle: int) -> None:
        super().__init__(asyncio.get_running_loop(), port, handle, len)
        self.lost: list[Exception] = []
        self.ended = asyncio.Event()

    def lose(self, error: Exception) -> None:
        if not self.is_closing:  # the thread may have told it twice, as it may tell `PolledLine.lose`
            self.lost.append(error)
            self.stop()
            self.ended.set()

    def write(self, data: bytes) -> None:
        raise AssertionError("only read")

    close = abort = close_without_loop = PolledLine.stop
    write_without_loop = write


class Sink:
    """Keeps what a port brings."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.chunks: list[bytes] = []
        self.times: list[int] = []
        self.arrivals: list[list[tuple[int, int]]] = []
        self.lost: list[DeviceLost | None] = []
        self.more = asyncio.Event()

    def data_received(self, data: bytes, now: int, arrivals: Sequence[tuple[int, int]] = ()) -> None:
        assert not self.lost
        self.data += data
        self.chunks.append(data)
        self.times.append(now)
        self.arrivals.append(list(arrivals))
        self.more.set()

    def connection_lost(self, error: DeviceLost | None) -> None:
        self.lost.append(error)
        self.more.set()

    async def until(self, size: int) -> None:
        """Return when that many bytes have come; the port must not be lost before."""
        await self._until(size)
        assert len(self.data) >= size, self.lost

    async def until_lost(self) -> DeviceLost | None:
        """Return what the port told when it was lost."""
        await self._until(1 << 60)
        (error,) = self.lost
        return error

    async def _until(self, size: int) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while len(self.data) < size and not self.lost:
                self.more.clear()
                await self.more.wait()


class Plan:
    """A schedule that the test writes."""

    def __init__(self, *rests: float, hold: float = 0.0, buffer_s: float = 60.0, latency: float = 0.005) -> None:
        self.rests = list(rests)
        self.latency = latency
        self.buffer_s = buffer_s
        self.until = hold

    @property
    def due(self) -> float:
        """Once each so late as the test says; then, until `hold`, in two milliseconds."""
        now = time.monotonic()
        return now + (self.rests.pop(0) if self.rests else 0.002 * (now < self.until))


class Seen:
    """A tap that keeps what it is shown."""

    def __init__(self, port: Port) -> None:
        self.reads: list[tuple[bytes, int]] = []
        port.add_tap(self)

    def __call__(self, direction: str, data: bytes, now: int) -> None:
        if direction == "in":
            self.reads.append((data, now))


@asynccontextmanager
async def opened(path: str, baudrate: int = 115200) -> AsyncIterator[tuple[Port, Sink]]:
    """A serial port, which is closed behind the block, and what it brings."""
    port, sink = await open_serial(path, baudrate), Sink()
    port.attach(sink)
    try:
        yield port, sink
    finally:
        await port.close()


@asynccontextmanager
async def opened_terminal(baudrate: int = 115200) -> AsyncIterator[tuple[Port, Sink, int]]:
    """A serial port that is a pseudo-terminal, what it brings, and the other end of it."""
    with terminal_pair() as (master, _, path):
        async with opened(path, baudrate) as (port, sink):
            yield port, sink, master


@contextmanager
def another_program(path: str = "", stderr: int | None = None) -> Iterator[subprocess.Popen[bytes]]:
    """A program that holds this port, or none, and has said so; it ends with its input."""
    opens = "os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); " if path else ""
    program = f"import os, sys; {opens}print(flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", program, path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=stderr) as other:
        assert other.stdout is not None
        other.stdout.readline()
        yield other


@contextmanager
def terminal_pair() -> Iterator[tuple[int, int, str]]:
    """Both ends of a pseudo-terminal, the controlling one first, and the path of the other."""
    import pty  # not on Windows, where the rest of this module is needed
    import tty

    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        yield master, slave, os.ttyname(slave)
    finally:
        for handle in (master, slave):
            with suppress(OSError):
                os.close(handle)


def written(master: int, size: int) -> bytes:
    """What was written at the other end of a pseudo-terminal: `size` bytes, and what came together with them.

    The kernel hands them over a moment after the write has returned. The loop stands still while this waits, so it
    shows all the same that they were written before.
    """
    data = b""
    while len(data) < size and select.select([master], [], [], PATIENCE_S)[0]:
        data += os.read(master, size + 16)
    return data


def arrived(sender: socket.socket) -> bool:
    """Wait, while the loop stands still, until the system has handed over what a socket of this machine sent."""
    if sys.platform == "linux":  # elsewhere it does so at once
        import fcntl
        import termios

        deadline = time.monotonic() + PATIENCE_S
        while any(fcntl.ioctl(sender, termios.TIOCOUTQ, bytes(4))):
            if time.monotonic() > deadline:
                return False
    return True


def open_files() -> int:
    """How many file descriptors this process holds; always 0 on Windows, which does not tell."""
    return len(os.listdir("/dev/fd")) if os.path.isdir("/dev/fd") else 0


def impatient(patch: pytest.MonkeyPatch) -> None:
    """Have a device that does not respond given up soon, not after the five seconds that a real one may need.

    Only two families are looked for, and no model that is dark while DTR is cleared.
    """
    families = tuple(replace(each, timing=replace(each.timing, forget_s=0.1), by_dtr={}) for each in FAMILIES[:2])
    patch.setattr("lidario.session.finding.connect.FAMILIES", families)
