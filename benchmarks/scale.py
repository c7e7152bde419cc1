"""Many lidars in one process, and where that ends.

All are S2 in DenseBoost mode, 32000 samples a second each. One other process plays them; so that it does not take
the machine for itself, it replays bytes made before, and writes what has come together every 4 ms rather than each
64 bytes. How late it was at most is printed: where it fell far behind, the reading was not what was measured. All
are started at once, so their revolutions end together too, which is the worst case for the delay.
"""

from __future__ import annotations

from typing import Any

from benchmarks.contest import Entry, late_by, lost_scans, read_live
from benchmarks.processes import Failed, Player
from benchmarks.report import Result, Setting, Table, median, percentile, spread, thinned

COUNTS = (1, 4, 16, 64, 256)
_RATE = "S2 DenseBoost"
_EVERY_S = 0.004
_LATENCIES = (0.005, 0.020)
_SKIP = 5
_SUMS = ("scans", "lost_scans", "damaged", "lost_bytes")


def run(setting: Setting) -> Result:
    """Every number of lidars at two latencies, one after the other, and again."""
    rounds, window_s = (1, 0.6) if setting.quick else (2, 3.0)
    found: dict[str, list[dict[str, Any]]] = {}
    broken: dict[str, str] = {}
    for number in range(rounds):
        setting.say(f"scale: round {number + 1} of {rounds}")
        for count in COUNTS[:2] if setting.quick else COUNTS:
            with Player(_RATE, count, every=_EVERY_S) as player:
                for latency in _LATENCIES[:1] if setting.quick else _LATENCIES:
                    name = f"{count} at {latency * 1000:g} ms"
                    try:
                        got, played = read_live(
                            setting, Entry(name, latency=latency), _RATE, player, settle_s=1.0, window_s=window_s
                        )
                    except Failed as failed:
                        broken[name] = str(failed)
                        continue
                    found.setdefault(name, []).append(_figures(count, latency, got, played))
    return Result("scale", [_table(found, broken)], {"counts": found, "broken": broken})


def _figures(count: int, latency: float, got: dict[str, Any], played: dict[str, Any]) -> dict[str, Any]:
    pairs = list(zip(got["arrivals"], played["turns"], strict=True))
    return {
        "lidars": count,
        "latency_s": latency,
        "cpu": got["cpu"],
        "wakeups": got["wakeups"],
        "rss_mb": got["rss_mb"],
        "late_ms": thinned([each for arrivals, turns in pairs for each in late_by(arrivals[_SKIP:], turns)]),
        "scans": sum(map(len, got["arrivals"])),
        "lost_scans": sum(lost_scans(arrivals, turns) for arrivals, turns in pairs),
        "lost_bytes": sum(played["lost_bytes"]),
        "damaged": sum(each["lost_packets"] + each["broken_scans"] for each in got["stats"]),
        "player_cpu_s": played["cpu_s"],
        "player_late_ms": played["late_ms"],
    }


def _table(found: dict[str, list[dict[str, Any]]], broken: dict[str, str]) -> Table:
    columns = ["lidars", "CPU, % of a core", "a lidar", "wake-ups/s", "p50, ms", "p99, ms", "max, ms", "scans"]
    columns += ["lost", "packets lost", "bytes lost", "RSS, MB", "player late, ms"]
    table = Table(f"scale: {_RATE}, all in one process", columns)
    for name, rounds in found.items():
        late = [each for one in rounds for each in one["late_ms"]]
        cpu = [100 * each["cpu"] for each in rounds]
        table.add(
            name,
            spread(cpu, 1),
            f"{median(cpu) / rounds[0]['lidars']:.2f}",
            f"{median([each['wakeups'] for each in rounds]):.0f}",
            *(f"{percentile(late, percent):.1f}" for percent in (50, 99, 100)),
            *(f"{sum(each[key] for each in rounds)}" for key in _SUMS),
            f"{median([each['rss_mb'] for each in rounds]):.0f}",
            f"{max(each['player_late_ms'] for each in rounds):.1f}",
        )
    table.notes.append("latency counts from the write of the delivery that completes a revolution")
    table.notes += [f"{name}: {why}" for name, why in broken.items()]
    return table
