"""What a process uses: seconds on the processor, wake-ups, resident memory.

Only the standard library is imported: the adapters of other drivers run in an environment of their own.
"""

from __future__ import annotations

import resource
import time
from pathlib import Path
from typing import Any

_STATUS = Path("/proc/self/status")


class Usage:
    """What this process uses from when it is made, all threads together."""

    def __init__(self) -> None:
        self._start = time.monotonic_ns()
        self._before = resource.getrusage(resource.RUSAGE_SELF)

    def seconds(self) -> float:
        """How long that is by now."""
        return (time.monotonic_ns() - self._start) * 1e-9

    def figures(self) -> dict[str, Any]:
        """Shares of a core, wake-ups a second, the most that was ever resident, and from when to when."""
        before, after, end = self._before, resource.getrusage(resource.RUSAGE_SELF), time.monotonic_ns()
        seconds = (end - self._start) * 1e-9
        return {
            "cpu": (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / seconds,
            "system": (after.ru_stime - before.ru_stime) / seconds,
            "wakeups": (after.ru_nvcsw - before.ru_nvcsw) / seconds,
            "window": [self._start, end],
            "rss_mb": resident_mb("VmHWM"),
        }


def resident_mb(what: str = "VmRSS") -> float:
    """MiB that are resident now, or were at most (``VmHWM``); without ``/proc``, at most in either case.

    `resource` alone would count the process that started this one.
    """
    if not _STATUS.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return int(_STATUS.read_text().partition(f"{what}:")[2].split()[0]) / 1024


def share_of(pid: int, window_s: float) -> float:
    """The share of a core that all threads of a process take in so many seconds from now."""
    begin, before = time.perf_counter(), seconds_of(pid)
    time.sleep(window_s)
    return (seconds_of(pid) - before) / (time.perf_counter() - begin)


def seconds_of(pid: int) -> float:
    """Seconds that a process was on the processor; the kernel counts nanoseconds for each thread."""
    return sum(int(each.read_text().split()[0]) for each in Path(f"/proc/{pid}/task").glob("*/schedstat")) * 1e-9
