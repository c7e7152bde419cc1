"""How long until something happens: opening, the first scan, the import, the command line.

Processes are timed from outside, from their start to their end, with warm file caches. Opening is timed from
inside, against a played device whose rotor turns already: `open_lidar` to the first scan, which contains the
partial revolution that is thrown away and the whole one behind it. What lidario alone takes, also where nothing is
named and where a program was killed, `benchmarks.opening` tells on a driven clock.
"""

from __future__ import annotations

import subprocess
import sys
import time

from benchmarks import opening
from benchmarks.contest import Entry, compete
from benchmarks.processes import ROOT, Player
from benchmarks.report import Result, Setting, Table, ratio, spread
from benchmarks.streams import LIVE

_COMMANDS = {
    "python -c pass": ["-c", "pass"],
    "import asyncio, numpy, serial": ["-c", "import asyncio, numpy, serial"],
    "import lidario": ["-c", "import lidario"],
    "lidario --version": ["-m", "lidario", "--version"],
}


def run(setting: Setting) -> Result:
    """Everything once, and again."""
    rounds = 2 if setting.quick else 9
    processes: dict[str, list[float]] = {}
    failed: dict[str, str] = {}
    for number in range(rounds):
        if number == 0:
            setting.say(f"start: {rounds} rounds of processes")
        for name, arguments in _COMMANDS.items():
            if name not in failed:
                _time_process(name, arguments, processes, failed)
    opened: dict[str, list[float]] = {}
    for rate in list(LIVE)[: 1 if setting.quick else None]:
        rivals = [Entry("pyrplidarsdk (C++)", "pyrplidarsdk")] if setting.peers and rate != "4ROS" else []
        taking_part = [Entry("lidario", latency=0.005), *rivals]
        with Player(rate) as player:
            found = compete(
                setting, "start", rate, player, taking_part, min(rounds, 5), lambda _, got, __: got, failed,
                settle_s=0.0, window_s=0.1,
            )  # fmt: skip
        opened |= {f"{rate}, {name}": [each["first_scan_s"] for each in times] for name, times in found.items()}
    driven, driven_s = opening.table()
    tables = [_process_table(processes, failed), _open_table(opened), driven]
    data = {"processes": processes, "first_scan_s": opened, "driven_first_scan_s": driven_s, "failed": failed}
    return Result("start", tables, data)


def _time_process(name: str, arguments: list[str], into: dict[str, list[float]], failed: dict[str, str]) -> None:
    start = time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    took = time.perf_counter() - start
    if done.returncode:
        failed[name] = (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
    else:
        into.setdefault(name, []).append(took)


def _process_table(processes: dict[str, list[float]], failed: dict[str, str]) -> Table:
    table = Table("start: processes", ["process", "ms", "python -c pass = 1"])
    for name, times in processes.items():
        baseline = processes.get("python -c pass", [])
        table.add(name, spread([1000 * each for each in times], 0), ratio(times, baseline))
    table.notes += [f"failed: {name}: {why}" for name, why in failed.items()]
    return table


def _open_table(opened: dict[str, list[float]]) -> Table:
    table = Table("start: opening to the first scan", ["device, reader", "s"])
    table.rows += [[name, spread(times, 2)] for name, times in opened.items()]
    table.notes.append("lidario throws the first, partial revolution away; pyrplidarsdk hands out what it has")
    return table
