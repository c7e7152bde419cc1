"""Every fault the simulator knows, on devices of each family: what becomes of it, and whether it is told.

lidario reads in memory, in driven time, so that its rows are the same every time. The bytes that the device sent
and those that arrived are both kept. A packet that arrived whole and unchanged is *intact*, and an intact packet
that is in no scan is lost *beyond* the damage. The device sees a circle of 2 m: a point elsewhere is *wrong*.

The same faults hit other drivers, each in a process of its own, on a pseudo-terminal and at true pace
(`benchmarks.fault_peers`); they are judged by what their user gets.

Three outcomes are failures, of whomever. It *hangs*: neither a scan nor an error comes for `PATIENCE_S`. It
*crashes*: an exception that is no `LidarError`, or the process dies. It is *silent*: scans come, samples are
missing or wrong, and no counter tells.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Any

import lidario
from benchmarks.fault_peers import judge_peers
from benchmarks.faulty_line import Recorder
from benchmarks.models import SUFFERERS
from benchmarks.report import Result, Setting, Table
from lidario.sim.faults import FAULTS, parse_faults
from tests.support.ledger import assert_stats_close
from tests.support.loop import run_driven

FAULT_AT_S = 3.0
"""When the faults happen that happen at a time; the device streams by then."""

PATIENCE_S = 15.0
_OBSERVED_S = 10.0
FAILURES = ("hangs", "crashes", "silent")

ROWS = (
    "drop:0.01%",
    "drop:1%",
    "flip:0.1%",
    "flip:1%",
    "insert:0.1%",
    "burst:0.01%",
    "duplicate:0.01%",
    "babble:100",
    "babble:1000",
    "garbage",
    "late:300ms",
    "stall:200ms",
    "silent:3s",
    "unplug:3s",
    "replug:3s",
    "reboot:3s",
    "freeze:3s",
    "protect:3s",
    "wrong-response:20%",
)
"""What is done; every word of `FAULTS` at least once."""

assert {row.partition(":")[0] for row in ROWS} == set(FAULTS)

TELLING = (
    "lost_packets",
    "skipped_bytes",
    "skipped_stretches",
    "missed_scans",
    "broken_scans",
    "stray_bytes",
    "late_responses",
)
"""Counters that tell of damage."""


@dataclass(slots=True)
class Outcome:
    """What became of one fault on one device.

    Attributes:
        outcome: In words; begins with one of `FAILURES` where it is one.
        scans: Scans that were delivered.
        damaged: Packets sent while the stream ran that did not arrive intact.
        recovered: Most intact packets in a row that were not recognised behind a damage.
        beyond: Intact packets between the first and the last scan that are in none.
        wrong: Share of the delivered samples that the device has not measured.
        told: Counters that are not 0 though they are without the fault.
        again: What a new session gets, where this one ended; empty where it went on.
    """

    outcome: str
    scans: int = 0
    damaged: int = 0
    recovered: int = 0
    beyond: int = 0
    wrong: float = 0.0
    told: dict[str, int] = field(default_factory=dict)
    again: str = ""


def run(setting: Setting) -> Result:
    """Every fault, on every device, in everybody's hands."""
    columns = ["fault", "outcome", "recovered within", "lost beyond", "wrong", "told", "a new session"]
    tables, data = list[Table](), dict[str, Any]()
    rows = ROWS[::6] if setting.quick else ROWS
    for model in SUFFERERS:
        table = Table(f"faults: lidario, {model}", columns)
        for row in rows:
            setting.say(f"faults: {row}, {model}")
            found = judge(model, row)
            data.setdefault(model, {})[row] = {name: getattr(found, name) for name in Outcome.__slots__}
            table.add(row, *_cells(found))
        table.notes += [
            "recovered within: packets from the first intact one behind a damage to the first that is recognised",
            "lost beyond: packets that arrived intact and are in no scan, of those damaged or lost",
        ]
        tables.append(table)
    if setting.peers is not None:
        peers, of_peers = judge_peers(setting, rows)
        tables += peers
        data["peers"] = of_peers
    return Result("faults", tables, data)


def judge(model: str, row: str, seed: int = 1) -> Outcome:
    """What becomes of one fault on one of `SUFFERERS`."""
    found = run_driven(lambda: _session(model, row, seed))
    if found.outcome.startswith("goes on") and (found.damaged or found.wrong) and not found.told:
        found.outcome = f"silent: {found.outcome}"
    return found


async def _session(model: str, row: str, seed: int) -> Outcome:
    device: Any = lidario.simulate(model, world="circle", spin_up=0)
    sufferer = SUFFERERS[model]
    family = sufferer.kind.family
    line = Recorder(device, parse_faults(row, seed=seed), sufferer.kind)
    loop, found = asyncio.get_running_loop(), Outcome("")
    began, samples, wrong = loop.time(), 0, 0
    stats: lidario.Stats | None = None
    # When the user is told; closing a device that responds to nothing takes two seconds more.
    told_at = began
    discarded: list[int] = []
    try:
        async with asyncio.timeout(PATIENCE_S + _OBSERVED_S) as limit:
            async with lidario.open_lidar(line, family=family) as lidar:
                try:
                    async with lidar.scans(sufferer.mode, depth=100) as stream:
                        async for scan in stream:
                            limit.reschedule(loop.time() + PATIENCE_S)
                            found.scans += 1
                            samples += len(scan)
                            wrong += _wrong(scan)
                            discarded.append(lidar.stats.discarded_packets)
                            line.mark()
                            if loop.time() - began >= _OBSERVED_S:
                                break
                finally:
                    stats, told_at = lidar.stats, loop.time()
        found.outcome = "goes on"
    except lidario.InternalError as error:
        found.outcome = f"crashes: {error}"
    except lidario.LidarError as error:
        found.outcome = _ended(error, row, began, told_at if stats else loop.time())
    except TimeoutError:
        found.outcome = "hangs"
    except Exception as error:
        found.outcome = f"crashes: {error!r}"
    found.wrong = wrong / samples if samples else 0.0
    if stats is not None:
        assert_stats_close(stats)
        found.told = {name: count for name in TELLING if (count := getattr(stats, name))}
        intact = line.intact()
        found.damaged, found.recovered = intact.damaged, intact.in_a_row
        found.beyond = intact.passed_over + (discarded[-1] - discarded[0] if discarded else 0)
    if found.outcome != "goes on":
        found.again = await _again(family, line, row)
    return found


async def _again(family: str, line: Recorder, row: str) -> str:
    """What a new session gets: on a line in order where the fault was an event, else on the same line."""
    loop = asyncio.get_running_loop()
    began = loop.time()
    line.reconnect(parse_faults("" if _is_event(row) else row, seed=2))
    try:
        async with lidario.open_lidar(line, family=family) as lidar:
            await lidar.scan()
    except lidario.LidarError as error:
        return f"{type(error).__name__} after {loop.time() - began:.1f} s"
    return f"scans after {loop.time() - began:.1f} s"


def _ended(error: Exception, row: str, began: float, now: float) -> str:
    """The error, and how long after its cause."""
    after = now - began - (FAULT_AT_S if _is_event(row) else 0.0)
    return f"{type(error).__name__} after {max(0.0, after):.1f} s"


def _is_event(row: str) -> bool:
    return row.endswith(f":{FAULT_AT_S:g}s")


def _wrong(scan: lidario.Scan) -> int:
    distances = scan.device_distances
    return int(((distances > 0) & (abs(distances - 2000.0) > 20.0)).sum())


def _cells(found: Outcome) -> list[str]:
    seen = found.scans > 0
    return [
        found.outcome,
        f"{found.recovered + 1} packets" if seen and found.damaged else "–",
        f"{found.beyond} of {found.damaged}" if seen else "–",
        f"{100 * found.wrong:.3f} %" if found.wrong else "0",
        ", ".join(f"{name} {count}" for name, count in found.told.items()) or "–",
        found.again or "–",
    ]
