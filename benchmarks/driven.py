"""An hour of scanning in seconds, to see what it leaves in memory: ``python -m benchmarks.driven '{…}'``.

The session, the port and the device are the real ones, in one process on an event loop whose clock jumps to the
next timer. The device hands over its bytes every 20 ms, so that the hour takes a minute.
"""

from __future__ import annotations

import asyncio
import gc
import json
import sys
import tracemalloc
from typing import Any

import lidario
from benchmarks.relayed import Relayed
from benchmarks.streams import RATES
from benchmarks.usage import resident_mb
from tests.support.loop import endless_loop

_STEP_NS = 20_000_000
_TRACED = 50
"""Revolutions."""


async def drive(task: dict[str, Any]) -> dict[str, Any]:
    """Scan for `minutes` of driven time; what is resident, allocated and lost at each of them."""
    rate = RATES[task["rate"]]
    loop = asyncio.get_running_loop()
    samples: list[dict[str, float]] = []
    scans = 0
    async with lidario.open_lidar(Relayed(rate.kind.device(), _STEP_NS), family=rate.kind.family) as lidar:
        start = loop.time()
        wanted = [60.0 * minute for minute in task["minutes"]]
        async with lidar.scans(depth=2) as stream:
            async for scan in stream:
                scans += 1
                del scan
                if loop.time() - start >= wanted[0]:
                    wanted.pop(0)
                    samples.append({"minute": (loop.time() - start) / 60, "scans": scans, **_memory()})
                    if not wanted:
                        break
            traced = await _trace(stream)
        stats = lidar.stats
    return {
        "samples": samples,
        "lost_packets": stats.lost_packets,
        "broken_scans": stats.broken_scans,
        "dropped_scans": stats.dropped_scans,
        **traced,
    }


def _memory() -> dict[str, float]:
    gc.collect()
    return {
        "rss_mb": resident_mb(),
        "blocks": sys.getallocatedblocks(),
        "objects": len(gc.get_objects()),
    }


async def _trace(stream: lidario.ScanStream) -> dict[str, float]:
    """What one revolution allocates at most at a time, and what is left of it, in KiB and in blocks."""
    tracemalloc.start()
    for _ in range(3):
        await anext(stream)
    gc.collect()
    before, blocks = tracemalloc.get_traced_memory()[0], sys.getallocatedblocks()
    peaks = []
    for _ in range(_TRACED):
        tracemalloc.reset_peak()
        held = tracemalloc.get_traced_memory()[0]
        scan = await anext(stream)
        peaks.append((tracemalloc.get_traced_memory()[1] - held) / 1024)
        size = sum(array.nbytes for array in (scan.angles, scan.ranges, scan.device_angles, scan.device_distances))
        del scan
    gc.collect()
    after, left = tracemalloc.get_traced_memory()[0], sys.getallocatedblocks()
    tracemalloc.stop()
    return {
        "peak_kib": sorted(peaks)[_TRACED // 2],
        "scan_kib": size / 1024,
        "left_bytes": (after - before) / _TRACED,
        "left_blocks": (left - blocks) / _TRACED,
    }


if __name__ == "__main__":
    with asyncio.Runner(loop_factory=endless_loop) as runner:
        print(json.dumps(runner.run(drive(json.loads(sys.argv[1])))))
