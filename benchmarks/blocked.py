"""A program that blocks its event loop: what is lost, and what of it is told.

Robot programs do: an OpenCV call, a planner, a model. The device is played by another process, on a pseudo-terminal
that holds 4 KiB as the kernel does behind a real adapter; what comes while it is full is lost. The program reads
for a while, then blocks several times: asleep, computing in Python, and in C code that keeps the interpreter lock.

Bytes are lost when the line could not take them, revolutions when they were played and did not come. For lidario
the table says also what its counters tell, and how far the time between two scans' stamps is off at most. Beside it
stands the vendor's C++ driver, which has a thread of its own; its Python wrapper hands out only the latest scan, so
revolutions that ended while the program was blocked do not come.
"""

from __future__ import annotations

from itertools import pairwise
from statistics import median as middle
from typing import Any

from benchmarks.blocking import KINDS
from benchmarks.contest import Entry, lost_scans, read_live
from benchmarks.processes import Failed, Player
from benchmarks.report import Result, Setting, Table
from lidario.session.opening import DEFAULT_LATENCY_S

BLOCKS_MS = (20, 50, 100, 200, 500, 1000, 2000)
HOLDS = 4096
"""Bytes that the line holds for a program that does not read."""
_DEVICES = ("S2 DenseBoost", "S3 DenseBoost", "4ROS")
_BLOCKED_S = 1.0
"""Blocks are repeated until the program was blocked for so long altogether, but at most `_MOST` times."""
_MOST = 5
_PAUSE_S = 0.3
_SETTLE_S = 0.4
_LONGEST_S = 25.0
"""Of the slowest row; what it takes is told by its blocks."""
_DEPTH = 400
_LATE_MS = 15.0
_ATTEMPTS = 4
"""A player that the machine kept waiting sends at once what it should have sent meanwhile. No device does, and the
line loses part of it whoever reads. Then it is measured again, so many times at most."""
_PEER = "pyrplidarsdk"


def run(setting: Setting) -> Result:
    """Every device, reader, kind and length of block, one after the other."""
    devices, blocks_ms = (_DEVICES[:1], (100, 500)) if setting.quick else (_DEVICES, BLOCKS_MS)
    found: list[dict[str, Any]] = []
    absent: dict[str, str] = {}
    for device in devices:
        with Player(device, holds=HOLDS) as player:
            readers = ["lidario"]
            if setting.peers is not None and device != "4ROS" and not setting.quick:
                readers.append(_PEER)
            for kind in KINDS:
                setting.say(f"blocked: {device}, {kind}")
                for block_ms in blocks_ms:
                    for reader in readers:
                        try:
                            figures = _measure(setting, reader, device, player, kind, block_ms)
                        except Failed as failed:
                            absent[f"{reader}, {device}, {kind}, {block_ms} ms"] = str(failed)
                            continue
                        about = {"device": device, "kind": kind, "block_ms": block_ms, "reader": reader}
                        found.append(about | figures)
    tables = [_table(device, [each for each in found if each["device"] == device]) for device in devices]
    tables[-1].note_absent(absent)
    return Result("blocked", tables, {"found": found, "absent": absent, "holds": HOLDS})


def _measure(
    setting: Setting, reader: str, device: str, player: Player, kind: str, block_ms: int
) -> dict[str, Any]:
    """The figures of one cell: of the first attempt at which the player was in time, or of its best one."""
    best: dict[str, Any] | None = None
    for _ in range(1 if setting.quick else _ATTEMPTS):
        figures = _figures(*_read(setting, reader, device, player, kind, block_ms))
        if best is None or figures["player_late_ms"] < best["player_late_ms"]:
            best = figures
        if best["player_late_ms"] <= _LATE_MS:
            break
    assert best is not None
    return best


def _read(
    setting: Setting, reader: str, device: str, player: Player, kind: str, block_ms: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    count = min(_MOST, max(1, round(_BLOCKED_S * 1000 / block_ms)))
    blocks = {"kind": kind, "block_s": block_ms / 1000, "count": count, "pause_s": _PAUSE_S}
    entry = Entry("lidario", latency=DEFAULT_LATENCY_S) if reader == "lidario" else Entry.of(reader)
    return read_live(
        setting, entry, device, player, settle_s=_SETTLE_S, window_s=_LONGEST_S, blocks=blocks, depth=_DEPTH
    )


def _figures(got: dict[str, Any], played: dict[str, Any]) -> dict[str, Any]:
    (arrivals,), stats = got["arrivals"], got.get("stats")
    figures = {
        "lost_bytes": played["lost_bytes"][0],
        "lost_share": played["lost_bytes"][0] / played["written_bytes"][0],
        "scans": len(arrivals),
        "lost_scans": lost_scans(arrivals, played["turns"][0]),
        "player_late_ms": played["late_ms"],
    }
    if stats is not None:
        periods = [(later - before) / 1e6 for before, later in pairwise(got["stamps"][0])]
        figures["told"] = {name: stats[0][name] for name in ("lost_packets", "broken_scans", "dropped_scans")}
        # A revolution that is missing is no error of the stamps around it.
        typical = middle(periods)
        figures["stamps_off_ms"] = max(abs(each - typical * max(1, round(each / typical))) for each in periods)
    return figures


def _table(device: str, found: list[dict[str, Any]]) -> Table:
    columns = ["blocked by", "ms", "reader", "bytes lost", "of all", "scans", "revolutions lost"]
    columns += ["told: packets lost", "broken", "dropped", "stamps off, ms"]
    table = Table(f"blocked: {device}, a line that holds {HOLDS} bytes", columns)
    for each in found:
        told = each.get("told")
        table.add(
            each["kind"],
            f"{each['block_ms']}",
            each["reader"],
            f"{each['lost_bytes']}",
            f"{100 * each['lost_share']:.1f} %",
            f"{each['scans']}",
            f"{each['lost_scans']}",
            *(("–",) * 3 if told is None else (f"{value}" for value in told.values())),
            f"{each['stamps_off_ms']:.1f}" if told is not None else "–",
        )
    late = max((each["player_late_ms"] for each in found), default=0.0)
    table.notes.append(f"the player was late by at most {late:.1f} ms")
    return table
