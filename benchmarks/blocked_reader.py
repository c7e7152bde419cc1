"""lidario in a program that blocks its event loop: ``python -m benchmarks.blocked_reader '{…}'``.

Reads one lidar and keeps every scan. Prints when each scan came into the consumer's hands, when it was measured,
and what the session counted.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from dataclasses import asdict
from typing import Any

import lidario
from benchmarks.blocking import Blocks

__all__ = ["read"]

_DEPTH = 400
_SETTLE_S = 0.4


async def read(task: dict[str, Any]) -> dict[str, Any]:
    """Do what `task` says: path, family, baudrate, and the arguments of `Blocks` as ``blocks``."""
    arrivals: list[int] = []
    stamps: list[int] = []

    async def consume() -> None:
        async for scan in scans:
            arrivals.append(time.monotonic_ns())
            stamps.append(scan.stamp_ns)

    options = {key: task[key] for key in ("family", "baudrate")}
    async with lidario.open_lidar(task["path"], **options) as lidar, lidar.scans(depth=_DEPTH) as scans:
        consumer = asyncio.create_task(consume())
        await asyncio.sleep(_SETTLE_S)
        blocks = Blocks(**task["blocks"])
        while blocks.block_if_due():  # noqa: ASYNC110 - it is a clock that is waited for
            await asyncio.sleep(0.01)
        consumer.cancel()
        stats = asdict(lidar.stats)
    return {"arrivals": arrivals, "stamps": stamps, "stats": stats}


if __name__ == "__main__":
    print(json.dumps(asyncio.run(read(json.loads(sys.argv[1])))))
