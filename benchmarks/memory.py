"""What it holds: resident memory after a minute and after an hour of scanning, and what a revolution allocates.

The hour is driven: `benchmarks.driven` tells how. Resident memory includes Python, numpy, and the simulated device
with the world it sees, since all are in that process; beside it stands an interpreter that has only imported numpy,
and the live reader, which has no device in it.
"""

from __future__ import annotations

import sys
from typing import Any

from benchmarks.contest import Entry, read_live
from benchmarks.processes import Player, run_json
from benchmarks.report import Result, Setting, Table

_PATIENCE_S = 400.0
_RATE = "S2 DenseBoost"
_BARE = """
import json, resource{more}
from pathlib import Path
pages = int(Path("/proc/self/statm").read_text().split()[1])
print(json.dumps({{"rss_mb": pages * resource.getpagesize() / 2**20}}))
"""


def run(setting: Setting) -> Result:
    """The driven hour, and the bare processes beside it."""
    minutes = [0.1, 0.5] if setting.quick else [1, 60]
    bare = {
        name: run_json([sys.executable, "-c", _BARE.format(more=more)], timeout=30)["rss_mb"]
        for name, more in (("Python", ""), ("Python and numpy", ", numpy"), ("import lidario", ", lidario"))
    }
    setting.say(f"memory: {_RATE}, {minutes[-1]:g} minutes driven")
    command = [sys.executable, "-m", "benchmarks.driven"]
    driven = run_json(command, timeout=_PATIENCE_S, given={"rate": _RATE, "minutes": minutes})
    with Player(_RATE) as player:
        entry = Entry("lidario", latency=0.005)
        live, _ = read_live(setting, entry, _RATE, player, settle_s=0.2, window_s=1.0)
    data = {"bare": bare, "driven": {_RATE: driven}, "live_rss_mb": live["rss_mb"]}
    return Result("memory", [_table(driven, bare, live["rss_mb"])], data)


def _table(found: dict[str, Any], bare: dict[str, float], live: float) -> Table:
    columns = ["device", "RSS, MB", "later, MB", "after", "scans", "blocks left a revolution"]
    columns += ["bytes left", "peak a revolution, KiB", "of which the scan"]
    table = Table("memory: an hour, driven", columns)
    first, last = found["samples"][0], found["samples"][-1]
    table.add(
        _RATE,
        f"{first['rss_mb']:.1f}",
        f"{last['rss_mb']:.1f}",
        f"{first['minute']:.1f} and {last['minute']:.1f} min",
        f"{last['scans']:.0f}",
        f"{(last['blocks'] - first['blocks']) / (last['scans'] - first['scans']):.4f}",
        f"{found['left_bytes']:.0f}",
        f"{found['peak_kib']:.0f}",
        f"{found['scan_kib']:.0f}",
    )
    table.notes += [f"{name}: {size:.1f} MB" for name, size in bare.items()]
    table.notes.append(f"a process that reads one S2 live: {live:.1f} MB at its most")
    return table
