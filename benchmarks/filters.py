"""What filters cost: each on a scan of 3200 samples in memory, and all of them in a program that reads scans.

Live, a simulated S2 is on a pseudo-terminal, in a process of its own. A second process reads it, by turns without
filters, with those of a reader, and with those of the settings, and tells its CPU time.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np

import lidario
from benchmarks.processes import run_json, started
from benchmarks.report import Result, Setting, Table, median, spread
from benchmarks.usage import Usage
from lidario import Config, LidarConfig, Mount, Scan
from lidario.filters import (
    AngularBoundsFilter,
    BoxFilter,
    Filter,
    IntensityFilter,
    MedianFilter,
    PolygonFilter,
    RadiusOutlierFilter,
    RangeFilter,
    ShadowsFilter,
)
from lidario.sim.rooms import make_world
from lidario.testing import make_scan

SAMPLES = 3200
EVERY: tuple[Filter, ...] = (
    AngularBoundsFilter([(-3.0, 3.0)]),
    RangeFilter(0.1, 12.0),
    IntensityFilter(10),
    BoxFilter(-0.3, 0.3, -0.2, 0.2, mount=Mount(0.1, 0.0, 0.5)),
    PolygonFilter([(-1.0, -0.3), (-0.4, -0.3), (-0.4, 0.3), (-1.0, 0.3)]),
    ShadowsFilter(),
    RadiusOutlierFilter(),
    MedianFilter(5),
)
_WAYS = ("scans()", "scans(filters=...)", "open_lidar(config=...)")
_CALLS = 100


def run(setting: Setting) -> Result:
    """Each in memory, then all of them live."""
    rounds, seconds = (2, 2.0) if setting.quick else (9, 10.0)
    scan = _room()
    named: dict[str, tuple[Filter, ...]] = {type(each).__name__: (each,) for each in EVERY}
    named |= {"all of them": EVERY}
    took: dict[str, list[float]] = {name: [] for name in named}
    cpu: dict[str, list[float]] = {way: [] for way in _WAYS}
    for number in range(rounds):
        setting.say(f"filters: round {number + 1} of {rounds}")
        for name, filters in named.items():
            took[name].append(_microseconds(scan, filters))
    for number in range(1 if setting.quick else 5):
        setting.say(f"filters: live, round {number + 1}")
        for way in _WAYS:
            cpu[way].append(_live(way, seconds))
    memory = Table(f"Filters, a scan of {SAMPLES} samples", ["filter", "us a scan"])
    memory.rows += [[name, spread(values)] for name, values in took.items()]
    live = Table("Filters, an S2 at 10 Hz on a pseudo-terminal", ["", "% of a core"])
    live.rows += [[way, spread([100 * each for each in values], 2)] for way, values in cpu.items()]
    more, settings = (median(cpu[way]) - median(cpu[_WAYS[0]]) for way in _WAYS[1:])
    live.notes.append(
        f"All eight filters add {100 * more:.2f} % of a core, and {100 * settings:.2f} % as settings of the lidar."
    )
    return Result("filters", [memory, live], {"memory": took, "live": cpu})


def _room() -> Scan:
    degrees = np.arange(SAMPLES) * 360.0 / SAMPLES
    millimetres = make_world("room", seed=1).ranges_mm(degrees, np.full(SAMPLES, 3.0))
    metres = np.where(millimetres > 0, millimetres / 1000.0, np.nan)
    return make_scan(-np.radians(degrees), metres, intensities=np.arange(SAMPLES) % 256)


def _microseconds(scan: Scan, filters: tuple[Filter, ...]) -> float:
    """The median of a call; each scan is a new one, of which nothing is computed yet."""
    found = []
    for _ in range(_CALLS):
        fresh = replace(scan)
        begin = time.perf_counter()
        fresh.filtered(*filters)
        found.append(1e6 * (time.perf_counter() - begin))
    return median(found)


def _live(way: str, seconds: float) -> float:
    """Share of a core."""
    with started("lidario", "sim", "rplidar-s2") as (_, path):
        task = {"path": path, "way": way, "seconds": seconds}
        got = run_json([sys.executable, "-m", "benchmarks.filters"], timeout=seconds + 30, given=task)
    return float(got["cpu"])


async def read(task: dict[str, Any]) -> dict[str, Any]:
    """Read scans for a while, from the fifth one on; what that cost."""
    config = Config(default=LidarConfig(filters=EVERY if task["way"] == _WAYS[2] else ()))
    async with (
        lidario.open_lidar(task["path"], config=config) as lidar,
        lidar.scans(filters=EVERY if task["way"] == _WAYS[1] else ()) as scans,
    ):
        for _ in range(5):
            await anext(scans)
        usage = Usage()
        while usage.seconds() < task["seconds"]:
            await anext(scans)
        return usage.figures()


if __name__ == "__main__":
    print(json.dumps(asyncio.run(read(json.loads(sys.argv[1])))))
