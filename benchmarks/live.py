"""Reading live: what it costs to keep up with a device at its own pace.

A separate process plays the device on a pseudo-terminal, in deliveries of 64 bytes as a USB adapter makes them.
CPU is what the reading process used, user and system time of all its threads, in percent of one core, from half
a second after its first scan on; wake-ups are its voluntary context switches. Scans are lost when turns were
played and did not come. One device is read once more through a bridge to the network.
"""

from __future__ import annotations

from typing import Any

from benchmarks.contest import compete, entries, lost_scans
from benchmarks.processes import Player
from benchmarks.report import Result, Setting, Table, median, ratio, spread
from benchmarks.streams import LIVE, RATES

_BRIDGED = "S2 DenseBoost"
_SLOW_TO_OPEN = "PyLidar3"
"""Sleeps for five seconds while it opens: too long for a quick run."""


def run(setting: Setting) -> Result:
    """Everybody who reads a device, one after the other, and again."""
    rounds, window_s = (1, 0.3) if setting.quick else (3, 2.0)
    found: dict[str, dict[str, list[dict[str, Any]]]] = {}
    absent = {f"{_SLOW_TO_OPEN}, 4ROS": "left out of a quick run"} if setting.quick else {}
    for rate in LIVE:
        taking_part = entries(rate, rivals=setting.peers is not None)
        with Player(rate) as player:
            found[rate] = compete(
                setting, "live", rate, player, taking_part, rounds, _figures, absent,
                settle_s=window_s / 4, window_s=window_s,
            )  # fmt: skip
    with Player(_BRIDGED, tcp=True) as player:
        found[f"{_BRIDGED}, over TCP"] = compete(
            setting, "live", _BRIDGED, player, entries(_BRIDGED, rivals=False), rounds, _figures, absent,
            settle_s=window_s / 4, window_s=window_s,
        )  # fmt: skip
    tables = [_table(rate, rounds) for rate, rounds in found.items()]
    tables[-1].note_absent(absent)
    return Result("live", tables, {"rates": found, "absent": absent, "window_s": window_s})


def _figures(rate: str, got: dict[str, Any], played: dict[str, Any]) -> dict[str, Any]:
    arrivals = got.pop("arrivals")[0]
    got.pop("stats", None)
    got["scans"] = len(arrivals)
    got["lost_scans"] = lost_scans(arrivals, played["turns"][0])
    got["lost_bytes"] = played["lost_bytes"][0]
    got["player_late_ms"] = played["late_ms"]
    got["samples_share"] = got["samples_per_s"] / RATES[rate].samples_per_s
    return got


def _table(rate: str, found: dict[str, list[dict[str, Any]]]) -> Table:
    about = RATES[rate.split(", over")[0]]
    columns = ["reader", "CPU, % of a core", "lidario at 5 ms = 1", "wake-ups/s", "samples", "scans", "lost"]
    size = f"{about.samples_per_s // 1000} kS/s"
    table = Table(f"live: {rate}, {size}", [*columns, "bytes lost", "first scan, s", "RSS, MB"])
    baseline = [each["cpu"] for each in next(iter(found.values()), [])]
    for name, rounds in found.items():
        cpu = [each["cpu"] for each in rounds]
        table.add(
            name,
            spread([100 * each for each in cpu], 2),
            ratio(cpu, baseline),
            f"{median([each['wakeups'] for each in rounds]):.0f}",
            f"{100 * median([each['samples_share'] for each in rounds]):.0f} %",
            f"{sum(each['scans'] for each in rounds)}",
            "–" if name == "PyLidar3" else f"{sum(each['lost_scans'] for each in rounds)}",
            f"{sum(each['lost_bytes'] for each in rounds)}",
            f"{median([each['first_scan_s'] for each in rounds]):.2f}",
            f"{median([each['rss_mb'] for each in rounds]):.0f}",
        )
    if rate == "4ROS":
        table.notes.append("PyLidar3 delivers pieces of 6000 bytes and 360 means of each, not scans and samples")
    elif rate in RATES:
        table.notes.append(
            "pyrplidarsdk, rplidar-roboticia, rplidar, adafruit: without the samples that have no return"
        )
    table.notes.append("of sectors, their number stands under scans; lost ones show in the share of samples")
    return table
