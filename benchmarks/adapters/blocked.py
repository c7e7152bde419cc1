"""Another driver in a program that blocks, a process of its own, as `benchmarks.blocked_reader` is for lidario."""

from __future__ import annotations

import time
from typing import Any

from benchmarks.adapters.drivers import DRIVERS
from benchmarks.adapters.process import respond
from benchmarks.blocking import Blocks

_SETTLE_S = 0.4


def main(task: dict[str, Any]) -> dict[str, Any]:
    arrivals: list[int] = []
    blocks: Blocks | None = None
    for _ in DRIVERS[task["contestant"]](task["path"], task["baudrate"], task["mode"]):
        arrivals.append(time.monotonic_ns())
        if arrivals[-1] - arrivals[0] < _SETTLE_S * 1e9:
            continue
        if blocks is None:
            blocks = Blocks(**task["blocks"])
        if not blocks.block_if_due():
            break
    return {"arrivals": arrivals}


if __name__ == "__main__":
    respond(main)
