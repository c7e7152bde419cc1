"""How late a scan is: from the last byte of a revolution to the scan in the consumer's hands.

A revolution is known to be over only when the first packet of the next one has come, so that packet's last byte
counts as the last one of the revolution. The player notes when it writes the delivery that holds it, on the clock
both processes share, before it writes. The reader notes the time when its ``async for`` body begins. An idle loop,
and one that computes for 20 ms out of every 50 ms, as an application might that should better not.
"""

from __future__ import annotations

from typing import Any

from benchmarks.contest import Entry, late_by, lost_scans, read_live
from benchmarks.processes import Player
from benchmarks.report import Result, Setting, Table, median, percentile
from benchmarks.streams import RATES

LATENCIES_MS = (0, 2, 5, 10, 20)
_RATE = "S2 DenseBoost"
_BUSY = {"busy_s": 0.020, "every_s": 0.050}
_SKIP = 5
"""First scans that do not count: caches are cold, and nothing is known of the rotor yet."""


def run(setting: Setting) -> Result:
    """Every setting, alone and beside a busy task, one after the other, and again."""
    rounds, window_s = (1, 1.0) if setting.quick else (3, 3.5)
    settings = LATENCIES_MS[:3:2] if setting.quick else LATENCIES_MS
    found: dict[str, list[dict[str, Any]]] = {}
    with Player(_RATE) as player:
        for number in range(rounds):
            setting.say(f"latency: round {number + 1} of {rounds}")
            for busy in (False, True):
                for latency in settings:
                    entry = Entry(f"{latency} ms{', busy' if busy else ''}", latency=latency / 1000)
                    more = _BUSY if busy else {}
                    got, played = read_live(setting, entry, _RATE, player, settle_s=0.1, window_s=window_s, **more)
                    arrivals, turns = got["arrivals"][0], played["turns"][0]
                    found.setdefault(entry.name, []).append(
                        {
                            "late_ms": late_by(arrivals[_SKIP:], turns),
                            "lost_scans": lost_scans(arrivals, turns),
                            "lost_bytes": played["lost_bytes"][0],
                            "cpu": got["cpu"],
                        }
                    )
    return Result("latency", [_table(found)], {"rate": _RATE, "settings": found, "busy": _BUSY})


def _table(found: dict[str, list[dict[str, Any]]]) -> Table:
    columns = ["setting", "p50, ms", "p99, ms", "max, ms", "scans", "lost", "CPU, %"]
    table = Table(f"latency: {_RATE}, {RATES[_RATE].samples_per_s // 1000} kS/s", columns)
    for name, rounds in found.items():
        late = [each for one in rounds for each in one["late_ms"]]
        table.add(
            name,
            *(f"{percentile(late, percent):.2f}" for percent in (50, 99, 100)),
            f"{len(late)}",
            f"{sum(each['lost_scans'] for each in rounds)}",
            f"{100 * median([each['cpu'] for each in rounds]):.2f}",
        )
    table.notes.append("over the scans of all rounds but the first five of each; busy: 20 ms of every 50 ms")
    return table
