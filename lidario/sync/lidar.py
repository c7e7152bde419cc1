"""The same session without ``await``: for notebooks, scripts, and programs that are not asynchronous.

The event loop runs in a thread of its own, one for each open lidar. So a session works where a loop runs already (a
notebook), and scans are received while the program computes: a reader gets the latest one. Each call hands a
coroutine of `Lidar` to that loop and waits for its result (`lidario.sync.loop_thread`). The methods are made
from those of `Lidar`, with their names, arguments and docstrings.
"""

from __future__ import annotations

import os
import re
import weakref
from collections.abc import Callable, Coroutine
from contextlib import suppress
from functools import update_wrapper
from inspect import signature
from typing import TYPE_CHECKING, Any, Concatenate, Final, ParamSpec, TypeVar

from lidario.basics.entered import Closing
from lidario.basics.model import DeviceInfo, Health, ScanMode, Stats
from lidario.config.read import Config, LidarConfig
from lidario.errors import SessionClosed
from lidario.port.line import Tap
from lidario.session.finding.reconnect import Reconnect
from lidario.session.lidar import Lidar
from lidario.session.opening import DEFAULT_LATENCY_S, open_lidar
from lidario.sync.loop_thread import LoopThread
from lidario.sync.streams import SyncLineChanges, SyncRecording, SyncScanStream, SyncSectorStream, called

if TYPE_CHECKING:
    from lidario.sim.device import SimulatedDevice

P = ParamSpec("P")
T = TypeVar("T")
S = TypeVar("S")


def _same(
    method: Callable[Concatenate[Lidar, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[SyncLidar, P], T]:
    """A method of `SyncLidar` that waits for this one of `Lidar`."""

    def waiting(self: SyncLidar, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._thread.call(method, self._lidar, *args, **kwargs)

    update_wrapper(waiting, method, assigned=("__name__", "__doc__"))
    waiting.__qualname__ = f"SyncLidar.{method.__name__}"
    return waiting


def _made(
    method: Callable[Concatenate[Lidar, P], T], given: Callable[[LoopThread, T, SyncLidar], S]
) -> Callable[Concatenate[SyncLidar, P], S]:
    """A method of `SyncLidar` that makes what this one of `Lidar` does, for use without ``await``."""

    def making(self: SyncLidar, /, *args: P.args, **kwargs: P.kwargs) -> S:
        # In the session's own thread: a loop may run in this one.
        return given(self._thread, self._there(lambda: method(self._lidar, *args, **kwargs)), self)

    update_wrapper(making, method, assigned=("__name__",))
    making.__qualname__ = f"SyncLidar.{method.__name__}"
    making.__doc__ = re.sub("``async (for|with)``", r"``\1``", method.__doc__ or "")
    shown: Any = making
    shown.__signature__ = signature(method).replace(return_annotation=given.__name__)
    return making


def _told(of: Any) -> Any:
    """A property of `SyncLidar` that tells what this one of `Lidar` does."""
    return property(lambda self: of.fget(self._lidar), doc=of.__doc__)


class SyncLidar(Closing):
    """One open device, for programs without ``await``; made by `open_sync`, and best used in ``with``.

    It has the methods of `Lidar`, which wait for their result. Threads may share it. Ctrl-C during any of them
    raises KeyboardInterrupt and cancels what was asked, as cancelling a task does. A session that is left open is
    closed when it is garbage or the interpreter exits.
    """

    def __init__(self, thread: LoopThread, lidar: Lidar) -> None:
        self._thread = thread
        self._lidar = lidar
        self._garbage = weakref.finalize(self, thread.end_soon)
        self._garbage.atexit = False
        # After the session's own finalizer, so before it at exit: then everything ends in order.
        thread.end_at_exit()

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

    info: Final[DeviceInfo] = _told(Lidar.info)
    health: Final[Health] = _told(Lidar.health)
    is_scanning: Final[bool] = _told(Lidar.is_scanning)
    is_connected: Final[bool] = _told(Lidar.is_connected)
    can_be_stopped: Final[bool] = _told(Lidar.can_be_stopped)
    motor_can_be_stopped: Final[bool] = _told(Lidar.motor_can_be_stopped)
    baudrate: Final[int] = _told(Lidar.baudrate)
    length_s: Final[float | None] = _told(Lidar.length_s)
    reached_s: Final[float | None] = _told(Lidar.reached_s)
    mode: Final[ScanMode | None] = _told(Lidar.mode)
    measured_scan_frequency: Final[float | None] = _told(Lidar.measured_scan_frequency)

    @property
    def stats(self) -> Stats:
        """Counters since the session was opened, summed over all lines to the device."""
        # Read in the loop, so that the counters belong together.
        try:
            return self._there(lambda: self._lidar.stats)
        except SessionClosed:
            return self._lidar.stats

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

    scans: Final = _made(Lidar.scans, SyncScanStream)
    sectors: Final = _made(Lidar.sectors, SyncSectorStream)
    line_changes: Final = _made(Lidar.line_changes, SyncLineChanges)
    record: Final = _made(Lidar.record, SyncRecording)

    def tap(self, tap: Tap) -> None:
        """As `Lidar.tap`. It is called in the session's own thread, and must not wait for the lidar."""
        self._there(lambda: self._lidar.tap(tap))

    def untap(self, tap: Tap) -> None:
        """Take `tap` out again. Harmless when it is not in."""
        with suppress(SessionClosed):
            self._there(lambda: self._lidar.untap(tap))

    def _there(self, call: Callable[[], T]) -> T:
        """What a call returns that is made in the session's own thread."""
        return self._thread.call(called, call)

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
        source, family=family, baudrate=baudrate, latency=latency, keep_spinning=keep_spinning,
        reconnect=reconnect, guard=guard, config=config,
    )  # fmt: skip
    thread = LoopThread()
    try:
        return SyncLidar(thread, thread.open(opening))
    except BaseException:
        thread.end()
        raise
