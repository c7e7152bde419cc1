"""What must hold after every step of a soak, whatever was done and whatever was broken."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import weakref
from pathlib import Path
from typing import Any, cast

import lidario
from benchmarks.soak.line import BadLine
from lidario.sim.device import Received, SimulatedDevice
from tests.support.discards import all_obeyed, was_in_time
from tests.support.ledger import assert_stats_close
from tests.support.loop import DrivenLoop

_FILES = Path("/proc/self/fd")
_TIDY_STEPS = 20  # of the event loop: callbacks that are due after a close
_MOST_MISSED = 60
"""A session that finds protection on, without having switched it on, learns that from one stream that ends after
three seconds, and starts it again. At 12 Hz, with a rotor that takes 2.5 s to speed up, that costs fewer scans."""


class Broken(AssertionError):
    """An invariant does not hold; the text says which, and the step behind which that was seen."""


class _Complaints(logging.Handler):
    """Keeps what is logged as an error: lidario logs as such only its own mistakes."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())


class Watch:
    """Checks one device and its sessions.

    Args:
        line: The device behind its line.
        loop: The driven loop.

    Attributes:
        own_tasks: Tasks of the soak itself, such as readers.
        own_timer: When the timer of the soak itself is due.
    """

    def __init__(self, line: BadLine, loop: DrivenLoop) -> None:
        self.own_tasks: set[asyncio.Task[Any]] = set()
        self.own_timer: float | None = None
        self._line = line
        self._loop = loop
        self._main = asyncio.current_task()
        self._files = _open_files()
        self._checked_ns = -1
        self._sessions: list[weakref.ref[lidario.Lidar]] = []
        self._complaints = _Complaints()
        self._loop.set_exception_handler(lambda _, context: self._complaints.texts.append(repr(context)))
        logging.getLogger("lidario").addHandler(self._complaints)

    def close(self) -> None:
        """Listen to the log no more."""
        logging.getLogger("lidario").removeHandler(self._complaints)

    def opened(self, lidar: lidario.Lidar) -> None:
        """A session was opened."""
        self._sessions.append(weakref.ref(lidar))

    def ledger(self, lidar: lidario.Lidar | None) -> None:
        """Every byte and packet is counted once."""
        if lidar is not None:
            assert_stats_close(lidar.stats)

    def nothing_lost(self, lidar: lidario.Lidar, *, guarded: bool) -> None:
        """On an undamaged line no packet was lost; `guarded` where a stream may have ended by protection."""
        stats = lidar.stats
        lost = stats.lost_packets + stats.broken_scans + stats.skipped_bytes
        if guarded and stats.restarts == 1:
            assert stats.missed_scans <= _MOST_MISSED, f"missed when protection was learned of: {stats}"
        else:
            lost += stats.missed_scans + stats.restarts
        assert not lost, f"lost on a healthy line: {stats}"

    def requests(self, *, clean: bool) -> None:
        """On an undamaged line the device has obeyed every request."""
        log = self._line.device.log
        new = 0
        while new < len(log) and log[-1 - new].at_ns > self._checked_ns:
            new += 1
        if new and clean and not all(map(was_in_time, log[-new:])):
            all_obeyed([cast("SimulatedDevice", _Logged(log[-new:]))])
        if new:
            self._checked_ns = log[-1].at_ns

    def complaints(self) -> None:
        """Nothing was logged as an error, and the event loop has heard of no exception."""
        if self._complaints.texts:
            raise AssertionError(f"complained: {self._complaints.texts[0]}")

    def tasks(self, *, is_open: bool) -> None:
        """No task is left; while a session is open it may start a stream in one."""
        left = asyncio.all_tasks() - self.own_tasks - {self._main}
        if is_open:
            left = {task for task in left if not task.get_name().startswith("lidario: ")}
        assert not left, f"tasks left behind: {left}"

    async def closed(self, *, reachable: bool) -> None:
        """Behind a close: no timer, no descriptor, and a device that could be reached is still."""
        for _ in range(_TIDY_STEPS):
            await asyncio.sleep(0)
        self.tasks(is_open=False)
        scheduled: list[asyncio.TimerHandle] = vars(self._loop)["_scheduled"]
        timers = [each for each in scheduled if not each.cancelled() and each.when() != self.own_timer]
        assert not timers, f"timers left behind: {timers}"
        files = _open_files()
        assert files == self._files, f"{files} descriptors are open, not {self._files}"
        if reachable:
            device = self._line.device
            assert not device.scanning, "the laser goes on"
            assert not device.motor_on, "the motor goes on"

    def collected(self) -> None:
        """No closed session is kept alive by anything."""
        gc.collect()
        kept = [each for each in self._sessions if each() is not None]
        assert not kept, f"{len(kept)} of {len(self._sessions)} sessions are kept alive"
        self._sessions.clear()


class _Logged:
    """As much of a device as `all_obeyed` asks for."""

    def __init__(self, log: list[Received]) -> None:
        self.log = log


def _open_files() -> int:
    return len(os.listdir(_FILES)) if _FILES.is_dir() else 0
