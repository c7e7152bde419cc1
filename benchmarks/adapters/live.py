"""Another driver reading live, as a process of its own to be measured.

The same figures as `benchmarks.reader` gives for lidario. The time before the first scan does not count, and the
window is cut at scans, since some drivers give control back only then.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import resource
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.adapters.drivers import ASYNC, DRIVERS
from benchmarks.adapters.plain import plain

_STDOUT = sys.stdout


class _Finished(Exception):
    """The window is over."""


class _Meter:
    """Counts scans, and measures from `settle_s` after the first to `window_s` later."""

    def __init__(self, settle_s: float, window_s: float) -> None:
        self._settle_ns, self._window_ns = round(settle_s * 1e9), round(window_s * 1e9)
        self._began = time.monotonic_ns()
        self._before: Any = None
        self._start = self._points = 0
        self.arrivals: list[int] = []
        self.result: dict[str, Any] = {}

    def scan(self, samples: int) -> None:
        now = time.monotonic_ns()
        self.arrivals.append(now)
        if now < self.arrivals[0] + self._settle_ns:
            return
        if self._before is None:
            self._before, self._start = resource.getrusage(resource.RUSAGE_SELF), now
            return
        self._points += samples
        if now >= self._start + self._window_ns:
            self._finish(now)
            raise _Finished

    def _finish(self, now: int) -> None:
        before, after = self._before, resource.getrusage(resource.RUSAGE_SELF)
        seconds = (now - self._start) * 1e-9
        self.result = {
            "cpu": (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / seconds,
            "system": (after.ru_stime - before.ru_stime) / seconds,
            "wakeups": (after.ru_nvcsw - before.ru_nvcsw) / seconds,
            "samples_per_s": self._points / seconds,
            "window": [self._start, now],
            "first_scan_s": (self.arrivals[0] - self._began) * 1e-9,
            "arrivals": [self.arrivals],
            "rss_mb": _most_resident_mb(),
        }


def _most_resident_mb() -> float:
    """The most that was resident. `resource` would count the process that started this one."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


async def _read_async(scans: Any, meter: _Meter) -> None:
    async for samples in scans:
        meter.scan(samples)


def main(task: dict[str, Any]) -> dict[str, Any]:
    meter = _Meter(task["settle_s"], task["window_s"])
    port, baudrate, mode = task["paths"][0], task["baudrate"], task["mode"]
    name = task["contestant"]
    with contextlib.suppress(_Finished):
        if name == "plain":
            asyncio.run(_read_async(plain(port, baudrate, task["form"]), meter))
        elif name in ASYNC:
            asyncio.run(_read_async(ASYNC[name](port, baudrate, mode), meter))
        else:
            for samples in DRIVERS[name](port, baudrate, mode):
                meter.scan(samples)
    return meter.result or {"failed": f"ended after {len(meter.arrivals)} scans"}


if __name__ == "__main__":
    sys.stdout = sys.stderr  # some drivers talk
    try:
        result = main(json.loads(sys.argv[1]))
    except Exception as error:
        result = {"failed": f"{type(error).__name__}: {error}"}
    print(json.dumps(result), file=_STDOUT, flush=True)
    os._exit(0)  # some drivers have threads that do not end
