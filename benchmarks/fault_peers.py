"""The faults of `benchmarks.faults` in the hands of other drivers, each in a process of its own.

They are judged by what their user gets, in the words that lidario is judged by. An exception of their own, of
pyserial or of the operating system is an error. Another one, such as an IndexError from the middle of a parser,
is a crash, for no user can expect it. They have no counters that a user could read, so a driver that hands out
fewer points than the device has measured, or wrong ones, and goes on is silent.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import lidario
from benchmarks.processes import Failed
from benchmarks.report import Setting, Table
from lidario.sim.faults import FAULTS, parse_faults
from lidario.sim.serve import PtyServer

RIVALS = (
    ("pyrplidar", "rplidar-s2"),
    ("rplidar-roboticia", "rplidar-s2"),
    ("pyrplidarsdk", "rplidar-s2"),
    ("lds2d", "ydlidar-4ros"),
    ("rplidar-roboticia", "rplidar-a1"),
    ("lds2d", "ldrobot-ld06"),
    ("lds2d", "ydlidar-x4"),
    ("lds2d", "ydlidar-x2"),
)
"""Who takes part, on which device."""

_SECONDS = 9.0
_FAULT_AT_S = 3.0
_QUIET_S = 3.0
"""Without a scan and without an error for so long, at the end: it hangs. Their own time limits are 3 s or less."""
_RADIUS_MM, _TOLERANCE_MM = 2000.0, 20.0
_MISSING = 0.05
"""A smaller share of missing points is the uncertainty of the comparison."""
_ERRORS = ("serial", "OSError", "_Refused", "TimeoutError", "PermissionError", "BrokenPipeError")
_NOTHING = "nothing"


@dataclass(frozen=True, slots=True)
class Told:
    """What the process of another driver told.

    Attributes:
        scans: Time in seconds, points and wrong points of each scan.
        ended: The exception that ended it; empty when there was none.
        died: Why the process told nothing; empty when it did.
        unread: Bytes that the line lost because the process did not read in time, as on a busy machine.
    """

    scans: Sequence[tuple[float, int, int]]
    ended: dict[str, Any]
    died: str = ""
    unread: int = 0

    def rate(self) -> float:
        """Points a second between the first and the last scan."""
        if len(self.scans) < 3:
            return 0.0
        return sum(points for _, points, _ in self.scans[1:]) / (self.scans[-1][0] - self.scans[0][0])


def judge_peers(setting: Setting, rows: Sequence[str]) -> tuple[list[Table], dict[str, Any]]:
    """Every fault in the hands of every other driver, all of them at a time."""
    assert setting.peers is not None
    absent = {name: why for name, _ in RIVALS if (why := setting.peers.why_absent(name))}
    there = {f"{name}, {model}": (name, model) for name, model in RIVALS if name not in absent}
    table = Table("faults: other drivers", ["fault", *there])
    data: dict[str, Any] = {"absent": absent}
    usual: dict[str, float] = {}
    with ThreadPoolExecutor(max(1, len(there))) as pool:
        for row in (_NOTHING, *rows):
            setting.say(f"faults: {row}, other drivers")
            every = pool.map(lambda rival, row=row: _run(setting, rival, row), there.values())
            told = dict(zip(there, every, strict=True))
            for name, each in told.items():
                if _starved(each):
                    told[name] = _run(setting, there[name], row)
            if row == _NOTHING:
                usual = {name: each.rate() for name, each in told.items()}
            words = {
                name: verdict(each, row, usual[name]) + (f" ({each.unread} bytes unread)" if _starved(each) else "")
                for name, each in told.items()
            }
            data[row] = words
            table.add(row, *words.values())
    table.notes += [f"{name}: {why}" for name, why in absent.items()]
    table.notes += [
        "missing: points handed out, against the row without a fault",
        "bytes unread: the line lost them because that driver did not read in time, in two runs; on a busy machine "
        "this says more about the machine",
    ]
    return [table], data


def verdict(told: Told, row: str, usual: float) -> str:
    """What the user of a driver gets, in words."""
    if told.died:
        return f"crashes: {told.died}"
    name = row.partition(":")[0]
    event = row.endswith(f":{_FAULT_AT_S:g}s")
    if told.ended:
        kind, module = told.ended["error"], told.ended["module"]
        expected = (
            module.startswith(_ERRORS) or kind in _ERRORS or module.startswith(("rplidar", "pyrplidar", "lds2d"))
        )
        after = max(0.0, told.ended["at_s"] - (_FAULT_AT_S if event else 0.0))
        text = told.ended["text"] if kind == "_Refused" else kind
        return f"{text} after {after:.1f} s" if expected else f"crashes: {text} after {after:.1f} s"
    if not told.scans:
        return "hangs: no scan, no error"
    quiet = _SECONDS - told.scans[-1][0]
    if quiet > _QUIET_S:
        return f"hangs: no scan and no error for the last {quiet:.1f} s"
    points = sum(points for _, points, _ in told.scans)
    wrong = sum(wrong for _, _, wrong in told.scans) / max(1, points)
    missing = 1 - told.rate() / usual if usual else 0.0
    bad = [f"{100 * missing:.0f} % missing"] if missing > _MISSING and name in FAULTS else []
    bad += [f"{100 * wrong:.2f} % wrong"] if wrong else []
    return f"silent: {', '.join(bad)}" if bad else "goes on"


def _starved(told: Told) -> bool:
    """Whether it went on to the end and did not read in time: then the machine may be to blame, not the fault."""
    return bool(told.unread) and not told.died


def _run(setting: Setting, rival: tuple[str, str], row: str) -> Told:
    name, model = rival
    device: Any = lidario.simulate(model, world="circle", spin_up=0)
    faults = None if row == _NOTHING else parse_faults(row, seed=1)
    task: dict[str, Any] = {"model": model, "baudrate": device.baudrate, "seconds": _SECONDS}
    task |= {"radius_mm": _RADIUS_MM, "tolerance_mm": _TOLERANCE_MM}
    with PtyServer(device, faults=faults, chunk=64) as server:
        try:
            told = setting.ask_peer(name, "faults", task | {"path": server.path}, timeout=_SECONDS + 15.0)
        except Failed as failed:
            return Told([], {}, str(failed))
    return Told(told["scans"], told["ended"], unread=server.lost)
