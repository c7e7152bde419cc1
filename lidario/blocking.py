"""The same session without ``await``: for notebooks, scripts, and programs that are not asynchronous.

::

    with lidario.open_sync() as lidar:
        for scan in lidar.scans():
            print(scan.ranges.min())

The event loop runs in a thread of its own, one for each open lidar. So a session works where a loop runs already (a
notebook), and scans are received while the program computes: a reader gets the latest one. Each call hands a
coroutine of `Lidar` to that loop and waits for its result (`lidario.session.loop_thread`). Names, arguments,
docstrings and errors are those of `Lidar`, since the methods are made from it.

Ctrl-C ends the wait. The stream that was read is left then, and the end of the ``with`` block closes the session.
A session that is left open is closed when it is garbage or the interpreter exits.
"""

from __future__ import annotations

import atexit
import os
import weakref
from collections.abc import Callable, Coroutine, Iterable
from contextlib import suppress
from functools import update_wrapper
from typing import TYPE_CHECKING, Any, Concatenate, Final, ParamSpec, TypeVar

from lidario.blocking_recording import SyncRecorder
from lidario.blocking_streams import SyncLineChanges, SyncScanStream, SyncSectorStream
from lidario.config.read import Config, LidarConfig
from lidario.entered import Closing
from lidario.errors import SessionClosed
from lidario.model import DeviceInfo, Health, ScanMode, Stats
from lidario.port.line import Tap
from lidario.scan import Scan
from lidario.sector import Sector
from lidario.session.finding.reconnect import Reconnect
from lidario.session.lidar import Lidar
from lidario.session.loop_thread import LoopThread
from lidario.session.opening import DEFAULT_LATENCY_S, open_lidar
from lidario.session.streaming.sectors import DEFAULT_DEGREES

if TYPE_CHECKING:
    from lidario.sim.device import SimulatedDevice

__all__ = ["SyncLidar", "open_sync"]

P = ParamSpec("P")
T = TypeVar("T")


def _same(
    method: Callable[Concatenate[Lidar, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[SyncLidar, P], T]:
    """A method of `SyncLidar` that waits for this one of `Lidar`."""

    def waiting(self: SyncLidar, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._thread.call(method, self._lidar, *args, **kwargs)

    update_wrapper(waiting, method, assigned=("__name__", "__doc__"))
    waiting.__qualname__ = f"SyncLidar.{method.__name__}"
    return waiting


def _as(told: object) -> Callable[[Callable[[SyncLidar], T]], Callable[[SyncLidar], T]]:
    """A property of `SyncLidar` with the docstring of this one of `Lidar`."""

    def tell(read: Callable[[SyncLidar], T]) -> Callable[[SyncLidar], T]:
        read.__doc__ = told.__doc__
        return read

    return tell


class SyncLidar(SyncRecorder, Closing):
    """One open device, for programs without ``await``; made by `open_sync`, and best used in ``with``.

    It has the methods of `Lidar`, which wait for their result. Threads may share it. Ctrl-C during any of them
    raises KeyboardInterrupt and cancels what was asked, as cancelling a task does.
    """

    def __init__(self, thread: LoopThread, lidar: Lidar) -> None:
        self._thread = thread
        self._lidar = lidar
        self._garbage = weakref.finalize(self, thread.end_soon)
        self._garbage.atexit = False
        # After the session's own finalizer, so before it at exit: then everything ends in order.
        atexit.register(thread.end)

    def __repr__(self) -> str:
        return f"<SyncLidar of {self._lidar!r}>"

    @property
    def source(self) -> str:
        """The source it was opened from."""
        return self._lidar.source

    @property
    def config(self) -> LidarConfig:
        """Its settings, of the file that `open_sync` was given."""
        return self._lidar.config

    @property
    def info(self) -> DeviceInfo:
        """What the device says it is."""
        return self._lidar.info

    @property
    @_as(Lidar.health)
    def health(self) -> Health:
        return self._lidar.health

    @property
    @_as(Lidar.is_scanning)
    def is_scanning(self) -> bool:
        return self._lidar.is_scanning

    @property
    @_as(Lidar.is_connected)
    def is_connected(self) -> bool:
        return self._lidar.is_connected

    @property
    @_as(Lidar.can_be_stopped)
    def can_be_stopped(self) -> bool:
        return self._lidar.can_be_stopped

    @property
    @_as(Lidar.baudrate)
    def baudrate(self) -> int:
        return self._lidar.baudrate

    @property
    @_as(Lidar.length_s)
    def length_s(self) -> float | None:
        return self._lidar.length_s

    @property
    @_as(Lidar.mode)
    def mode(self) -> ScanMode | None:
        return self._lidar.mode

    @property
    @_as(Lidar.measured_scan_frequency)
    def measured_scan_frequency(self) -> float | None:
        return self._lidar.measured_scan_frequency

    @property
    @_as(Lidar.stats)
    def stats(self) -> Stats:
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
    get_network_address: Final = _same(Lidar.get_network_address)
    get_zero_offset: Final = _same(Lidar.get_zero_offset)
    set_network_address: Final = _same(Lidar.set_network_address)
    set_baudrate: Final = _same(Lidar.set_baudrate)
    set_motor_speed: Final = _same(Lidar.set_motor_speed)
    set_power_down_protection: Final = _same(Lidar.set_power_down_protection)
    set_scan_frequency: Final = _same(Lidar.set_scan_frequency)
    set_zero_offset: Final = _same(Lidar.set_zero_offset)

    def scans(
        self,
        mode: str | int | None = None,
        *,
        depth: int = 1,
        force: bool = False,
        filters: Iterable[Callable[[Scan], Scan]] = (),
    ) -> SyncScanStream:
        """A stream of full revolutions, for ``for``; as `Lidar.scans`, and several threads may read one each."""
        stream = self._lidar.scans(mode, depth=depth, force=force, filters=filters)
        return SyncScanStream(self._thread, stream, self)

    # The whole of it, from one place.
    scans.__doc__ = (Lidar.scans.__doc__ or "").replace("``async for``", "``for``")

    def sectors(
        self,
        degrees: float = DEFAULT_DEGREES,
        mode: str | int | None = None,
        *,
        depth: int | None = None,
        force: bool = False,
        filters: Iterable[Callable[[Sector], Sector]] = (),
    ) -> SyncSectorStream:
        """A stream of parts of revolutions, each as soon as it is measured, for ``for``; as `Lidar.sectors`."""
        stream = self._lidar.sectors(degrees, mode, depth=depth, force=force, filters=filters)
        return SyncSectorStream(self._thread, stream, self)

    sectors.__doc__ = (Lidar.sectors.__doc__ or "").replace("``async for``", "``for``")

    def line_changes(self) -> SyncLineChanges:
        """As `Lidar.line_changes`, for ``for``."""
        return SyncLineChanges(self._thread, self._there(self._lidar.line_changes))

    def tap(self, tap: Tap) -> None:
        """As `Lidar.tap`. It is called in the session's own thread, and must not wait for the lidar."""
        self._there(lambda: self._lidar.tap(tap))

    def untap(self, tap: Tap) -> None:
        """Take `tap` out again. Harmless when it is not in."""
        with suppress(SessionClosed):
            self._there(lambda: self._lidar.untap(tap))

    def _there(self, call: Callable[[], T]) -> T:
        """What a call returns that is made in the session's own thread."""

        async def made() -> T:
            return call()

        return self._thread.call(made)

    def close(self) -> None:
        """Stop laser and motor, close the port and end the thread. Harmless when done before.

        Everything that other threads wait for ends with SessionClosed. Ctrl-C ends only the waiting.
        """
        self._thread.end()
        self._garbage.detach()


def open_sync(
    source: str | os.PathLike[str] | SimulatedDevice = "auto",
    *,
    family: str | None = None,
    baudrate: int | None = None,
    latency: float = DEFAULT_LATENCY_S,
    keep_spinning: bool = False,
    reconnect: bool | Reconnect = False,
    guard: bool = False,
    config: Config | str | os.PathLike[str] | None = None,
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
        guard=guard,
        config=config,
    )
    thread = LoopThread()
    try:
        return SyncLidar(thread, thread.open(opening))
    except BaseException:
        thread.end()
        raise
