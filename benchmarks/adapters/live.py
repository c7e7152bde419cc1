"""Another driver reading live, as a process of its own to be measured.

The same figures as `benchmarks.reader` gives for lidario. The time before the first scan does not count, and the
window is cut at scans, since some drivers give control back only then.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from typing import Any

from benchmarks.adapters.drivers import ASYNC, DRIVERS
from benchmarks.adapters.plain import plain
from benchmarks.adapters.process import respond
from benchmarks.blocking import Blocks
from benchmarks.usage import Usage


class _Finished(Exception):
    """The window is over."""


class _Meter:
    """Counts scans, and measures from `settle_s` after the first to `window_s` later, or until all blocks end."""

    def __init__(self, settle_s: float, window_s: float, blocks: dict[str, Any] | None) -> None:
        self._blocks: Blocks | None = None
        self._about_blocks = blocks
        self._settle_ns, self._window_s = round(settle_s * 1e9), window_s
        self._began = time.monotonic_ns()
        self._usage: Usage | None = None
        self._points = 0
        self.arrivals: list[int] = []
        self.result: dict[str, Any] = {}

    def scan(self, samples: int) -> None:
        now = time.monotonic_ns()
        self.arrivals.append(now)
        if now < self.arrivals[0] + self._settle_ns:
            return
        if self._usage is None:
            self._usage = Usage()
            self._blocks = None if self._about_blocks is None else Blocks(**self._about_blocks)
            return
        self._points += samples
        seconds = self._usage.seconds()
        over = seconds >= self._window_s if self._blocks is None else not self._blocks.block_if_due()
        if over:
            self.result = {
                **self._usage.figures(),
                "samples_per_s": self._points / seconds,
                "first_scan_s": (self.arrivals[0] - self._began) * 1e-9,
                "arrivals": [self.arrivals],
            }
            raise _Finished


async def _read_async(scans: Any, meter: _Meter) -> None:
    async for samples in scans:
        meter.scan(samples)


def main(task: dict[str, Any]) -> dict[str, Any]:
    meter = _Meter(task["settle_s"], task["window_s"], task.get("blocks"))
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
    respond(main)
