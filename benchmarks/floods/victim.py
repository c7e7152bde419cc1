"""A program that reads scans beside a ticker: ``python -m benchmarks.floods.victim SOURCE SECONDS MODE``.

It says ``ready`` when scans come, and after so many seconds what it has seen, as JSON.
"""

from __future__ import annotations

import asyncio
import json
import resource
import sys
import time
from pathlib import Path

import lidario
from benchmarks.usage import resident_mb
from lidario.errors import LidarError
from lidario.ros.fleet import Fleet

TICK_S = 0.01
WARM = 3
"""Scans that come before the flood."""
_MOST_MB = 4096


class Ticker:
    """Wakes every ten milliseconds, and notes how late.

    Attributes:
        late: Seconds, of each tick.
        busy: The part of that in which this thread may have computed; the rest it waited for a core, or for the
            interpreter.
    """

    def __init__(self) -> None:
        self.late: list[float] = []
        self.busy: list[float] = []
        self._computed = time.thread_time()
        self._loop = asyncio.get_running_loop()
        self._due = self._loop.time() + TICK_S
        self._loop.call_at(self._due, self._tick)

    def _tick(self) -> None:
        now = self._loop.time()
        computed, self._computed = self._computed, time.thread_time()
        self.late.append(now - self._due)
        self.busy.append(min(self.late[-1], self._computed - computed))
        self._due = now + TICK_S
        self._loop.call_at(self._due, self._tick)


def begun_mb() -> float:
    """``VmRSS`` now; ``VmHWM`` counts from here on."""
    Path("/proc/self/clear_refs").write_text("5")
    return resident_mb()


async def beside(seconds: float) -> dict[str, float]:
    """Tell that scans come, and tick for so long."""
    before = begun_mb()
    print("ready", flush=True)
    ticker = Ticker()
    await asyncio.sleep(seconds)
    return {
        "late_ms": 1e3 * max(ticker.late),
        "busy_ms": 1e3 * max(ticker.busy),
        "memory_mb": resident_mb("VmHWM") - before,
        "ticks": len(ticker.late),
    }


async def session(source: str, seconds: float, mode: str) -> dict[str, float]:
    """A lidar, and a reader of it."""
    scans, warm = 0, asyncio.Event()

    async def read() -> None:
        nonlocal scans
        try:
            async with lidar.scans(mode or None) as stream:
                async for _ in stream:
                    scans += 1
                    if scans == WARM:
                        warm.set()
        except LidarError as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)

    async with lidario.open_lidar(source) as lidar:
        reading = asyncio.create_task(read())
        await warm.wait()
        found = await beside(seconds)
        reading.cancel()
        await asyncio.wait([reading])
        stats = lidar.stats
    return {
        **found,
        "scans": scans,
        "received_mb": stats.bytes_received / 1e6,
        "dropped_mb": stats.discarded_bytes / 1e6,
    }


async def fleet(source: str, seconds: float) -> dict[str, float]:
    """A reader of all lidars."""
    keys, router = source.removeprefix("fleet:").split("?router=")
    scans, warm = 0, asyncio.Event()

    async def read() -> None:
        nonlocal scans
        async for _ in lidars:
            scans += 1
            if scans == WARM:
                warm.set()

    async with Fleet(keys, router=router) as lidars:
        reading = asyncio.create_task(read())
        await warm.wait()
        found = await beside(seconds)
        reading.cancel()
        await asyncio.wait([reading])
    return {**found, "scans": scans, "dropped": lidars.dropped}


def main(arguments: list[str]) -> None:
    """Run it, in bounded memory."""
    source, seconds, mode = arguments[0], float(arguments[1]), arguments[2]
    resource.setrlimit(resource.RLIMIT_DATA, (_MOST_MB << 20, _MOST_MB << 20))
    run = fleet(source, seconds) if source.startswith("fleet:") else session(source, seconds, mode)
    print(json.dumps(asyncio.run(run)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
