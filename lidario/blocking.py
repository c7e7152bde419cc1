"""The same session without ``await``: for notebooks, scripts, and programs that are not asynchronous.

::

    with lidario.open_sync() as lidar:
        for scan in lidar.scans():
            print(scan.ranges.min())

The event loop runs in a thread of its own, one for each open lidar. So a session works where a loop runs already (a
notebook), and scans are received while the program computes: a reader gets the latest one. Each call hands a
coroutine of `Lidar` to that loop and waits for its result. Names, arguments, docstrings and errors are those of
`Lidar`, since the methods are made from it.

Ctrl-C ends the wait. The stream that was read is left then, and the end of the ``with`` block closes the session.
A session that is left open is closed when it is garbage or the interpreter exits.
"""

from __future__ import annotations

import atexit
import os
import sys
import threading
import weakref
from collections.abc import Callable, Coroutine
from concurrent.futures import Future, wait
from contextlib import suppress
from functools import update_wrapper
from types import TracebackType
from typing import TYPE_CHECKING, Any, Concatenate, Final, ParamSpec, Self, TypeVar

import anyio
from anyio.from_thread import BlockingPortal

from lidario.errors import LidarError, LocalProtocolError, SessionClosed
from lidario.model import DeviceInfo, Health, ScanMode, Stats
from lidario.port.line import Tap
from lidario.recording.record import Recording
from lidario.scan import Scan
from lidario.session.lidar import Lidar
from lidario.session.opening import DEFAULT_LATENCY_S, OpenLidar, open_lidar
from lidario.session.reconnect import Reconnect
from lidario.session.stream import ScanStream

if TYPE_CHECKING:
    from lidario.sim.device import SimulatedDevice

__all__ = ["SyncLidar", "SyncRecording", "SyncScanStream", "open_sync"]

P = ParamSpec("P")
T = TypeVar("T")

_WAIT_S = 0.2 if sys.platform == "win32" else None
"""On Windows Ctrl-C does not end a wait that has no limit, so the wait is divided."""


class _Thread:
    """An event loop in a thread, and the session that lives there."""

    def __init__(self) -> None:
        self._lidar: Lidar | None = None
        self._pid = os.getpid()
        self._portal: Future[BlockingPortal] = Future()
        self._thread = threading.Thread(target=anyio.run, args=(self._run,), name="lidario", daemon=True)
        self._ending = threading.Lock()
        self._ended: Future[None] | None = None

    def open(self, opening: OpenLidar) -> Lidar:
        """Start the thread and open the session in it."""

        async def kept() -> Lidar:
            # Noted here and not by the caller, whom Ctrl-C may reach before it has noted anything.
            self._lidar = await opening
            return self._lidar

        self._thread.start()
        wait((self._portal,))
        return self.call(kept)

    async def _run(self) -> None:
        async with BlockingPortal() as portal:
            self._portal.set_result(portal)
            await portal.sleep_until_stopped()

    @property
    def belongs_here(self) -> bool:
        """False in a child of the process that opened the session: a fork copies no threads."""
        return os.getpid() == self._pid

    def call(self, function: Callable[P, Coroutine[Any, Any, T]], *args: P.args, **kwargs: P.kwargs) -> T:
        """Run a coroutine in the loop and return its result; what ends the wait early cancels the coroutine."""
        if not self.belongs_here:
            raise LocalProtocolError("the lidar was opened before a fork: only the parent process can use it")
        try:
            future: Future[T] = self._portal.result().start_task_soon(lambda: function(*args, **kwargs))
        except RuntimeError:
            if self._ended is None:
                raise LocalProtocolError(
                    "a tap is called by the lidar's own thread, which cannot wait for itself"
                ) from None
            raise SessionClosed("the session was closed; open_sync() makes a new one") from None
        try:
            while not wait((future,), _WAIT_S).done:
                pass
            return future.result()
        finally:
            future.cancel()

    def end(self) -> None:
        """Close the session and end the thread. Harmless when done before. Ctrl-C ends only the waiting."""
        ended = self.end_soon()
        while not wait((ended,), _WAIT_S).done:
            pass
        ended.result()

    def end_soon(self) -> Future[None]:
        """Have another thread end it: the garbage collector may run in any, also in the one that is to be ended."""
        with self._ending:
            if self._ended is None:
                self._ended = Future()
                if self.belongs_here:
                    # Not a daemon: the interpreter waits for it, so that the device is left still.
                    threading.Thread(target=self._end, args=(self._ended,), name="lidario-close").start()
                else:
                    self._ended.set_result(None)
            return self._ended

    def end_now(self) -> None:
        """End it in this thread: while the interpreter exits, none can be started."""
        with self._ending:
            if self._ended is not None or not self.belongs_here:
                return
            self._ended = Future()
        self._end(self._ended)

    def _end(self, ended: Future[None]) -> None:
        atexit.unregister(self.end_now)
        try:
            if self._thread.ident is not None:
                portal = self._portal.result()
                if self._lidar is not None:
                    portal.call(self._lidar.close)
                portal.call(portal.stop, True)  # a session that is being opened too
                self._thread.join()
        except BaseException as error:
            ended.set_exception(error)
        else:
            ended.set_result(None)


def _same(
    method: Callable[Concatenate[Lidar, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[SyncLidar, P], T]:
    """A method of `SyncLidar` that waits for this one of `Lidar`."""

    def waiting(self: SyncLidar, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._thread.call(method, self._lidar, *args, **kwargs)

    update_wrapper(waiting, method, assigned=("__name__", "__doc__"))
    waiting.__qualname__ = f"SyncLidar.{method.__name__}"
    return waiting


class SyncLidar:
    """One open device, for programs without ``await``; made by `open_sync`, and best used in ``with``.

    It has the methods of `Lidar`, which wait for their result. Threads may share it. Ctrl-C during any of them
    raises KeyboardInterrupt and cancels what was asked, as cancelling a task does.
    """

    def __init__(self, thread: _Thread, lidar: Lidar) -> None:
        self._thread = thread
        self._lidar = lidar
        self._garbage = weakref.finalize(self, thread.end_soon)
        self._garbage.atexit = False
        # After the session's own finalizer, so before it at exit: then everything ends in order.
        atexit.register(thread.end_now)

    def __repr__(self) -> str:
        return f"<SyncLidar of {self._lidar!r}>"

    @property
    def source(self) -> str:
        """The source it was opened from."""
        return self._lidar.source

    @property
    def info(self) -> DeviceInfo:
        """What the device says it is."""
        return self._lidar.info

    @property
    def health(self) -> Health:
        """What it last said of its state."""
        return self._lidar.health

    @property
    def is_scanning(self) -> bool:
        """Whether a stream runs or is about to; also for the second after its last reader has gone."""
        return self._lidar.is_scanning

    @property
    def is_connected(self) -> bool:
        """Whether there is a line to the device; False after its loss, also while the session comes back."""
        return self._lidar.is_connected

    @property
    def baudrate(self) -> int:
        """As `Lidar.baudrate`."""
        return self._lidar.baudrate

    @property
    def mode(self) -> ScanMode | None:
        """The scan mode that runs, if one does."""
        return self._lidar.mode

    @property
    def measured_scan_frequency(self) -> float | None:
        """Measured revolutions a second, from the latest scan; None before the first."""
        return self._lidar.measured_scan_frequency

    @property
    def stats(self) -> Stats:
        """Counters since the session was opened."""
        lidar = self._lidar

        async def stats() -> Stats:
            return lidar.stats

        # Read in the loop, so that the counters belong together.
        try:
            return self._thread.call(stats)
        except SessionClosed:
            return lidar.stats

    scan: Final = _same(Lidar.scan)
    stop: Final = _same(Lidar.stop)
    reset: Final = _same(Lidar.reset)
    get_info: Final = _same(Lidar.get_info)
    get_health: Final = _same(Lidar.get_health)
    get_modes: Final = _same(Lidar.get_modes)
    get_sample_rate: Final = _same(Lidar.get_sample_rate)
    get_scan_frequency: Final = _same(Lidar.get_scan_frequency)
    get_scan_frequency_range: Final = _same(Lidar.get_scan_frequency_range)
    get_zero_offset: Final = _same(Lidar.get_zero_offset)
    set_motor_speed: Final = _same(Lidar.set_motor_speed)
    set_power_down_protection: Final = _same(Lidar.set_power_down_protection)
    set_scan_frequency: Final = _same(Lidar.set_scan_frequency)
    set_zero_offset: Final = _same(Lidar.set_zero_offset)

    def scans(self, mode: str | int | None = None, *, depth: int = 1, force: bool = False) -> SyncScanStream:
        """A stream of full revolutions, for ``for``; several may run side by side, also in several threads.

        Args:
            mode: Name or id of a scan mode; None for the one that runs, or else the device's typical one.
            depth: Scans kept for a reader that falls behind; the oldest beyond that are dropped and counted.
            force: Ask the device to measure even when the motor is not up to speed.

        Raises:
            InvalidValue: `depth` is no number of scans.
        """
        return SyncScanStream(self._thread, self._lidar.scans(mode, depth=depth, force=force), self)

    def tap(self, tap: Tap) -> None:
        """As `Lidar.tap`. It is called in the session's own thread, and must not wait for the lidar."""

        async def add() -> None:
            self._lidar.tap(tap)

        self._thread.call(add)

    def untap(self, tap: Tap) -> None:
        """Take `tap` out again. Harmless when it is not in."""

        async def remove() -> None:
            self._lidar.untap(tap)

        with suppress(SessionClosed):
            self._thread.call(remove)

    def record(
        self, path: str | os.PathLike[str], *, scans: bool = False, overwrite: bool = False
    ) -> SyncRecording:
        """As `Lidar.record`, for use in ``with``."""

        async def made() -> Recording:
            return self._lidar.record(path, scans=scans, overwrite=overwrite)

        return SyncRecording(self._thread, self._thread.call(made))

    def close(self) -> None:
        """Stop laser and motor, close the port and end the thread. Harmless when done before.

        Everything that other threads wait for ends with SessionClosed. Ctrl-C ends only the waiting.
        """
        self._thread.end()
        self._garbage.detach()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class SyncScanStream:
    """An iterator of full revolutions; made by `SyncLidar.scans`.

    As `ScanStream`, with ``for`` and ``with``: scans come in while the program does something else, and the reader
    gets the latest one. The device begins to scan at the first ``next``. Ctrl-C, or any other exception that is
    raised while it waits, leaves the stream; the last stream to be left stops laser and motor a second later.
    """

    def __init__(self, thread: _Thread, stream: ScanStream, lidar: SyncLidar) -> None:
        self._thread = thread
        self._stream = stream
        self._lidar = lidar  # held, so that the session is not closed while somebody reads

    @property
    def dropped(self) -> int:
        """Scans this reader has missed so far."""
        return self._stream.dropped

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Scan:
        try:
            scan = self._thread.call(_next, self._stream)
        except BaseException:
            self._release()
            raise
        if scan is None:
            raise StopIteration
        return scan

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the stream. The last one to be left stops laser and motor. Harmless when done before."""
        with suppress(SessionClosed):
            self._thread.call(self._stream.aclose)

    def _release(self) -> None:
        async def release() -> None:
            self._stream.release()

        with suppress(LidarError):
            self._thread.call(release)


class SyncRecording:
    """A recording that is made while its ``with`` block runs; made by `SyncLidar.record`.

    Attributes:
        recording: The same as `Lidar.record` makes: its size, its counts, and what ended it early.
    """

    def __init__(self, thread: _Thread, recording: Recording) -> None:
        self.recording: Recording = recording
        self._thread = thread

    def __enter__(self) -> Recording:
        self._thread.call(self.recording.start)
        return self.recording

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # A session that was closed in the block has ended its recordings.
        with suppress(SessionClosed):
            self._thread.call(self.recording.close)


async def _next(stream: ScanStream) -> Scan | None:
    # StopAsyncIteration cannot pass through a future.
    try:
        return await anext(stream)
    except StopAsyncIteration:
        return None


def open_sync(
    source: str | os.PathLike[str] | SimulatedDevice = "auto",
    *,
    family: str | None = None,
    baudrate: int | None = None,
    latency: float = DEFAULT_LATENCY_S,
    keep_spinning: bool = False,
    reconnect: bool | Reconnect = False,
) -> SyncLidar:
    """Open a device for a program without ``await``, for use in ``with``.

    Arguments and errors are those of `open_lidar`. It returns when the device is open. Ctrl-C meanwhile leaves
    laser and motor off and the port closed. It may be called where an event loop runs, as in a notebook; that loop
    stands still until the call returns.
    """
    opening = open_lidar(
        source,
        family=family,
        baudrate=baudrate,
        latency=latency,
        keep_spinning=keep_spinning,
        reconnect=reconnect,
    )
    thread = _Thread()
    try:
        return SyncLidar(thread, thread.open(opening))
    except BaseException:
        thread.end()
        raise
