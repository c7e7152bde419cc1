"""How soon a robot stops: from the last byte that shows an obstacle to the stop, by scans and by sectors.

A thin obstacle appears in a random direction at a random time before a simulated lidar, which a process of its own
plays on a pseudo-terminal at true pace (`benchmarks.reaction_player`). Another process reads it and notes when it
would stop (`benchmarks.reaction_reader`). A scan tells of it when the revolution has ended, a sector when the
sector has. By turns: each way at each speed, and again.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from bisect import bisect_left
from typing import Any

from benchmarks.processes import ROOT
from benchmarks.report import Result, Setting, Table, percentile

__all__ = ["SPEEDS_HZ", "run"]

SPEEDS_HZ = (7, 10, 20)
_MODELS = {7: "ydlidar-4ros", 10: "rplidar-s2", 20: "rplidar-s2"}
_KINDS = ("scans", "sectors")
_LATEST_S = 1.0
"""What comes later than that belongs to another time."""


def run(setting: Setting) -> Result:
    """Each speed, by scans and by sectors, one after the other, and again."""
    rounds, seconds = (1, 1.5) if setting.quick else (3, 6.0)
    speeds = SPEEDS_HZ[1:2] if setting.quick else SPEEDS_HZ
    found: dict[str, list[float]] = {}
    missed: dict[str, int] = {}
    for number in range(rounds):
        setting.say(f"reaction: round {number + 1} of {rounds}")
        for hertz in speeds:
            for kind in _KINDS:
                late, unseen = _once(kind, hertz, seconds, seed=number)
                name = f"{hertz} Hz, {_MODELS[hertz]}, {kind}"
                found.setdefault(name, []).extend(late)
                missed[name] = missed.get(name, 0) + unseen
    return Result("reaction", [_table(found, missed)], {"late_ms": found, "missed": missed})


def _once(kind: str, hertz: int, seconds: float, seed: int) -> tuple[list[float], int]:
    """Milliseconds from the last byte to the stop, each time, and how often none came."""
    command = [sys.executable, "-m", "benchmarks.reaction_player", _MODELS[hertz], str(hertz), str(seed)]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as player:
        assert player.stdin is not None
        assert player.stdout is not None
        path = player.stdout.readline().strip()
        shown: list[dict[str, int]] = []
        listening = threading.Thread(target=lambda: shown.extend(map(json.loads, player.stdout or ())))
        listening.start()
        try:
            done = subprocess.run(
                [sys.executable, "-m", "benchmarks.reaction_reader", path, kind, str(hertz), str(seconds)],
                cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True, timeout=seconds + 60,
            )  # fmt: skip
        finally:
            player.stdin.close()
            listening.join()
    return paired(shown, json.loads(done.stdout))


def paired(shown: list[dict[str, int]], stops: list[int]) -> tuple[list[float], int]:
    """Milliseconds from each `seen_ns` to the first stop since it was shown; and how many had none.

    Args:
        shown: Each time that the obstacle was there: since when, and when its last byte was written.
        stops: When something near was found, ascending.
    """
    late: list[float] = []
    unseen = 0
    for each in shown:
        if not stops or not stops[0] < each["since_ns"] < stops[-1]:
            continue  # before the reader was there, or behind its end
        at = bisect_left(stops, each["since_ns"])
        after = (stops[at] - each["seen_ns"]) * 1e-6
        if after < _LATEST_S * 1e3:
            late.append(after)
        else:
            unseen += 1
    return late, unseen


def _table(found: dict[str, list[float]], missed: dict[str, int]) -> Table:
    table = Table(
        "reaction: from the last byte that shows an obstacle to the stop",
        ["speed, by", "p50, ms", "p99, ms", "max, ms", "times", "not seen"],
    )
    for name, late in found.items():
        figures: list[Any] = [f"{percentile(late, percent):.1f}" if late else "–" for percent in (50, 99, 100)]
        table.rows.append([name, *figures, f"{len(late)}", f"{missed[name]}"])
    table.notes.append("sectors of 45 degrees; `latency` as it is by default, 5 ms; the obstacle is 2 degrees wide")
    return table
