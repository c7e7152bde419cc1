"""lidario reading live, as a process of its own to be measured: ``python -m benchmarks.reader '{…}'``.

Opens the lidars named, reads their scans for a while, and prints what that took: CPU time, context switches,
when each scan came into the consumer's hands, when it was measured, and what the session counted. The time before
all lidars have delivered a scan does not count. Beside the reading it may keep the loop busy, as an application
that computes does, or block it for long (`benchmarks.blocked`).
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from contextlib import AsyncExitStack
from dataclasses import asdict
from typing import Any

import lidario
from benchmarks.blocking import KINDS, Blocks
from benchmarks.usage import Usage


async def read(task: dict[str, Any]) -> dict[str, Any]:
    """Do what `task` says: paths, family, baudrate, latency, settle_s, window_s; perhaps depth, blocks, busy_s.

    With `degrees` sectors of that width are read, and not scans.
    """
    arrivals: list[list[int]] = [[] for _ in task["paths"]]
    samples: list[list[int]] = [[] for _ in task["paths"]]
    stamps: list[list[int]] = [[] for _ in task["paths"]]
    began = time.monotonic_ns()
    options = {key: task[key] for key in ("family", "baudrate", "latency") if key in task}
    async with AsyncExitStack() as stack:
        lidars = await asyncio.gather(
            *(stack.enter_async_context(lidario.open_lidar(path, **options)) for path in task["paths"])
        )
        async with asyncio.TaskGroup() as group:
            degrees, depth = task.get("degrees"), task.get("depth", 4)
            readers = [
                group.create_task(_consume(lidar.sectors(degrees) if degrees else lidar.scans(depth=depth), *each))
                for lidar, *each in zip(lidars, arrivals, samples, stamps, strict=True)
            ]
            if task.get("busy_s"):
                readers.append(group.create_task(_busy(task["busy_s"], task["every_s"])))
            while not all(arrivals):  # noqa: ASYNC110 - an event for each would be work in the measured loop
                await asyncio.sleep(0.02)
            await asyncio.sleep(task["settle_s"])
            usage = Usage()
            if "blocks" in task:
                blocks = Blocks(**task["blocks"])
                while blocks.block_if_due():  # noqa: ASYNC110 - it is a clock that is waited for
                    await asyncio.sleep(0.01)
            else:
                await asyncio.sleep(task["window_s"])
            used = usage.figures()
            for reader in readers:
                reader.cancel()
        stats = [asdict(lidar.stats) for lidar in lidars]
    return {
        **used,
        "samples_per_s": sum(map(_rate, arrivals, samples)),
        "first_scan_s": (max(each[0] for each in arrivals) - began) * 1e-9,
        "arrivals": arrivals,
        "stamps": stamps,
        "stats": stats,
    }


async def _consume(
    stream: lidario.ScanStream | lidario.SectorStream, arrivals: list[int], samples: list[int], stamps: list[int]
) -> None:
    async with stream:
        async for scan in stream:
            arrivals.append(time.monotonic_ns())
            # As a program would that wants radians and metres; they are made when they are looked at.
            samples.append(min(len(scan.angles), len(scan.ranges)))
            stamps.append(scan.stamp_ns)


def _rate(arrivals: list[int], samples: list[int]) -> float:
    """Points a second, from the first scan to the last."""
    seconds = (arrivals[-1] - arrivals[0]) * 1e-9
    return sum(samples[1:]) / seconds if seconds else 0.0


async def _busy(busy_s: float, every_s: float) -> None:
    """Compute for `busy_s` out of every `every_s`, without letting the loop do anything else meanwhile."""
    while True:
        KINDS["Python"](busy_s)
        await asyncio.sleep(every_s - busy_s)


if __name__ == "__main__":
    print(json.dumps(asyncio.run(read(json.loads(sys.argv[1])))))
