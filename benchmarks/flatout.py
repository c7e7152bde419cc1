"""Reading faster than life: the same bytes at fifty times their pace, and as fast as each reader takes them.

It is the one place where the vendor's C++ can be timed beside lidario's decoding, since it opens nothing but a
port. The terminal hands over at most 4 KiB at a time, so this is decoding in chunks of that size, plus the kernel.
What counts is CPU time for each megabyte, since the reader shares the machine with the process that writes.

Two paces, because they answer two questions. Flat out shows how fast bytes can be taken at all; but a driver with
no queue then throws most revolutions away before anybody has seen them, which is cheap. At fifty times the true
pace nearly all of them can be delivered, so the costs are those of the same work.
"""

from __future__ import annotations

from typing import Any

from benchmarks.contest import Entry, compete
from benchmarks.processes import Player
from benchmarks.report import Result, Setting, Table, median, ratio, spread
from benchmarks.streams import RATES, recording

_ENTRIES = {
    "S2 DenseBoost": ("pyrplidarsdk", "plain", "pyrplidar"),
    "S2 Standard": ("pyrplidarsdk", "plain", "pyrplidar"),
    "4ROS": ("plain", "lds2d-4ros"),
}
_SPEEDS = {50: "fifty times the true pace", 0: "flat out"}
_EVERY_S = 0.0005


def run(setting: Setting) -> Result:
    """Everybody, one after the other, and again."""
    rounds, window_s = (1, 0.2) if setting.quick else (3, 0.7)
    found: dict[str, dict[str, dict[str, list[dict[str, Any]]]]] = {}
    absent: dict[str, str] = {}
    for speed, pace in list(_SPEEDS.items())[: 1 if setting.quick else None]:
        found[pace] = {}
        for rate, rivals in _ENTRIES.items():
            taking_part = [Entry("lidario"), *(map(Entry.of, rivals) if setting.peers else ())]
            with Player(rate, every=_EVERY_S, speed=speed) as player:
                found[pace][rate] = compete(
                    setting, pace, rate, player, taking_part, rounds, _figures, absent,
                    settle_s=window_s / 5, window_s=window_s,
                )  # fmt: skip
    tables = [_table(pace, by_rate) for pace, by_rate in found.items()]
    tables[-1].note_absent(absent)
    return Result("flatout", tables, {"paces": found, "absent": absent})


def _figures(rate: str, got: dict[str, Any], played: dict[str, Any]) -> dict[str, Any]:
    got.pop("stats", None)
    got.pop("arrivals")
    read, seconds = played["written_bytes"][0] - played["lost_bytes"][0], played["active_s"][0]
    got["mb_per_s"] = read / seconds / 1e6
    got["pace"] = played["written_bytes"][0] / seconds / len(recording(RATES[rate].kind).loop)
    got["samples_share"] = got["samples_per_s"] / RATES[rate].samples_per_s / got["pace"]
    got["cpu_s_per_mb"] = got["cpu"] / got["mb_per_s"]
    return got


def _table(pace: str, found: dict[str, dict[str, list[dict[str, Any]]]]) -> Table:
    columns = ["device, reader", "times true pace", "samples delivered", "CPU, ms/MB", "lidario = 1"]
    table = Table(f"through a pseudo-terminal, {pace}", columns)
    for rate, by_name in found.items():
        baseline = _cost(by_name.get("lidario", []))
        for name, rounds in by_name.items():
            cost = _cost(rounds)
            times = spread([each["pace"] for each in rounds], 0)
            share = f"{100 * median([each['samples_share'] for each in rounds]):.0f} %"
            table.add(f"{rate}, {name}", times, share, spread(cost, 1), ratio(cost, baseline))
    table.notes.append("samples delivered: share of those written; some leave out samples without a return (2–3 %)")
    return table


def _cost(rounds: list[dict[str, Any]]) -> list[float]:
    return [1000 * each["cpu_s_per_mb"] for each in rounds]
