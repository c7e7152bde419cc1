"""How soon a robot stops: from the last byte that shows an obstacle to the call of `stop`; scans against sectors.

The device is simulated, on a pseudo-terminal, in a process of its own: something comes near at a known moment in a
direction drawn by chance, and the device knows when it wrote the packet that shows it. A program that reads scans
sees it when the revolution is whole. One that reads sectors sees it when the rotor has passed the sector's end.
"""

from __future__ import annotations

import json
import sys
from bisect import bisect_left
from typing import Any

from benchmarks.contest import late_by
from benchmarks.processes import run_json, started
from benchmarks.report import Result, Setting, Table, median, percentile, spread

HERTZ = (7, 10, 20)
_WAYS = ("scans", "sectors")
_EARLY_NS = 30_000_000
"""A part of the obstacle in the sector before is reason enough to stop."""
_LATEST_NS = 240_000_000
_SKIP = 8
"""First records that do not count: caches are cold, and nothing is known of the rotor yet."""
_WORKER = "benchmarks.reaction_worker"


def run(setting: Setting) -> Result:
    """Every speed, both ways by turns."""
    rounds, window_s = (1, 3.0) if setting.quick else (3, 16.0)
    found: dict[str, list[dict[str, Any]]] = {}
    for number in range(rounds):
        setting.say(f"reaction: round {number + 1} of {rounds}")
        for hertz in HERTZ[1:2] if setting.quick else HERTZ:
            for how in _WAYS:
                found.setdefault(f"{hertz} Hz, {how}", []).append(_measure(hertz, how, window_s))
    return Result("reaction", [_table(found)], {"settings": found})


def _measure(hertz: int, how: str, window_s: float) -> dict[str, Any]:
    with started(_WORKER, "device") as (device, path):
        task = {"path": path, "hertz": hertz, "how": how, "window_s": window_s}
        got = run_json([sys.executable, "-m", _WORKER, "reader"], timeout=window_s + 30, given=task)
        told = json.loads(device.communicate("\n", timeout=30)[0])
    begin, end = got["window"][0], min(got["window"][1], *told["noted"])
    within = [at for at in told["shown"] if begin < at < end - _LATEST_NS]
    late = [reaction for at in within if (reaction := _reaction(at, got["stops"])) is not None]
    return {
        "late_ms": late,
        "shown": len(within),
        "cpu": got["cpu"],
        "delay_ms": late_by([at for at in got["arrivals"][_SKIP:] if at < end], told["ends"]),
    }


def _reaction(shown_ns: int, stops: list[int]) -> float | None:
    """Milliseconds until the first stop; None where none came while the obstacle was there."""
    place = bisect_left(stops, shown_ns - _EARLY_NS)
    if place == len(stops) or stops[place] > shown_ns + _LATEST_NS:
        return None
    return (stops[place] - shown_ns) / 1e6


def _table(found: dict[str, list[dict[str, Any]]]) -> Table:
    columns = [
        "setting",
        "p50, ms",
        "p99, ms",
        "max, ms",
        "obstacles",
        "not seen",
        "handed over p50, p99",
        "CPU, %",
    ]
    table = Table("reaction: simulated S2, 32 kS/s, sectors of 45 degrees", columns)
    for name, rounds in found.items():
        late = [each for one in rounds for each in one["late_ms"]]
        delays = [each for one in rounds for each in one["delay_ms"]]
        shown = sum(each["shown"] for each in rounds)
        table.add(
            name,
            *(f"{percentile(late, percent):.1f}" for percent in (50, 99, 100)),
            f"{shown}",
            f"{shown - len(late)}",
            f"{percentile(delays, 50):.1f}, {percentile(delays, 99):.1f}",
            spread([100 * each["cpu"] for each in rounds], 2),
        )
    for hertz in HERTZ:
        both = [found.get(f"{hertz} Hz, {how}") for how in _WAYS]
        if both[0] and both[1]:
            scans, sectors = (median([each["cpu"] for each in rounds]) for rounds in both if rounds)
            table.notes.append(f"{hertz} Hz: sectors() takes {sectors / scans:.1f} times the CPU of scans()")
    table.notes.append(
        "handed over: from the last byte of the packet behind the sector, or revolution, to the consumer"
    )
    table.notes.append(
        "p50 to max: from the last byte that shows the obstacle, as it is written, to the call of stop"
    )
    return table
