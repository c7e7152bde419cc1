"""Lidars on the network: what publishing costs beside scanning alone, and many publishers into one reader.

A separate process plays an S2 on a pseudo-terminal. ``lidario publish`` reads it as a process of its own, in each
of its forms, through a zenoh router that is another process; its time on the processor is read from ``/proc`` (all
threads). Beside it stands `benchmarks.reader`, which only scans.

Then so many publishers send whole scans of 3200 samples, 10 a second each, and one `Fleet` reads them all. The
publishers are clients of the router in one process, which makes no scans: the machine shall have time for the
reader. Latency is counted from just before the sending to the reader's hands, by the one clock of this machine.
"""

from __future__ import annotations

import asyncio
import json
import socket
import sys
import time
import timeit
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, Final

import numpy as np

from benchmarks.contest import Entry, read_live
from benchmarks.processes import Failed, Player, started
from benchmarks.report import Result, Setting, Table, median, percentile, spread
from benchmarks.usage import seconds_of, share_of
from lidario import DeviceInfo, Health, HealthStatus, Scan, Stats
from lidario.network.bus import Bus
from lidario.network.messages import encode_scan
from lidario.ros import Fleet, diagnostics, pointcloud2
from lidario.testing import make_scan

RATE: Final = "S2 DenseBoost"
FORMS: Final = {
    "publish --ros": ["--ros"],
    "publish --zenoh KEY": ["--zenoh", "bench/scan"],
    "publish --zenoh KEY --raw": ["--zenoh", "bench/scan", "--raw"],
}
COUNTS: Final = (1, 8, 32)
HERTZ: Final = 10
SAMPLES: Final = 3200
_SETTLE_S: Final = 1.0


def run(setting: Setting) -> Result:
    """Publishing beside scanning, several times in turn; then each number of publishers once."""
    rounds, window_s = (1, 0.5) if setting.quick else (3, 4.0)
    data: dict[str, Any] = {"cpu": {}, "many": {}, "message_ms": _messages(5 if setting.quick else 500)}
    with _router() as address, Player(RATE) as player:
        for number in range(rounds):
            setting.say(f"publish: round {number + 1} of {rounds}")
            _one_round(setting, player, address, window_s, data["cpu"])
            player.report()
    for count in (1, 2) if setting.quick else COUNTS:
        setting.say(f"publish: {count} into one")
        with _router(data) as address:
            data["many"][str(count)] = _many(count, address, 1.0 if setting.quick else 10.0, data)
    data.pop("router", None)
    return Result("publish", _tables(data), data)


def _tables(data: dict[str, Any]) -> list[Table]:
    cpu = data["cpu"]
    costs = Table("Publishing beside scanning: S2, 32 kS/s, 10 Hz", ["", "CPU, % of a core", "more than scanning"])
    alone = median(cpu.get("scanning alone", []))
    for name, values in cpu.items():
        more = "" if name == "scanning alone" else f"{median(values) - alone:+.2f}"
        costs.add(name, spread(values, 2), more)
    many = Table(
        "Publishers of whole scans (29 kB, 10 Hz each) into one reader",
        ["publishers", "reader, CPU %", "router, CPU %", "latency p50, ms", "p99, ms", "scans", "lost"],
    )
    for count, found in data["many"].items():
        many.add(
            count, f"{found['reader_cpu']:.1f}", f"{found['router_cpu']:.1f}", f"{found['p50_ms']:.2f}",
            f"{found['p99_ms']:.2f}", str(found["scans"]), str(found["lost"]),
        )  # fmt: skip
    made = Table(f"One scan of {SAMPLES} samples as a message, ms", ["", "best of five"])
    made.rows += [[name, f"{took:.4f}"] for name, took in data["message_ms"].items()]
    return [costs, many, made]


def _messages(times: int) -> dict[str, float]:
    """Milliseconds that each message takes."""
    scan = _scan()
    laser, cloud = scan.to_laserscan(), pointcloud2(scan)
    info = DeviceInfo("", "S2", 0, "1.0", 0, "0" * 32)
    array = diagnostics(0, "lidario: scan", info, Health(HealthStatus.OK, 0), stats=Stats(), rate=10.0)
    steps: dict[str, Callable[[], object]] = {
        "Scan.to_laserscan": scan.to_laserscan,
        "LaserScan.to_cdr": laser.to_cdr,
        "pointcloud2(scan)": lambda: pointcloud2(scan),
        "PointCloud2.to_cdr": cloud.to_cdr,
        "DiagnosticArray.to_cdr": array.to_cdr,
        "scan message of --zenoh": lambda: encode_scan(scan),
    }
    return {name: 1e3 * min(timeit.repeat(step, number=times, repeat=5)) / times for name, step in steps.items()}


def _one_round(
    setting: Setting, player: Player, address: str, window_s: float, cpu: dict[str, list[float]]
) -> None:
    with suppress(Failed):
        entry = Entry("lidario", latency=0.005)
        alone, _ = read_live(setting, entry, RATE, player, settle_s=0.5, window_s=window_s)[:2]
        cpu.setdefault("scanning alone", []).append(100 * alone["cpu"])
    for name, options in FORMS.items():
        with started("lidario", "publish", player.paths[0], *options, "--router", address) as (it, _):
            time.sleep(2 * _SETTLE_S)
            cpu.setdefault(name, []).append(100 * share_of(it.pid, window_s))


def _many(count: int, address: str, seconds: float, data: dict[str, Any]) -> dict[str, Any]:
    with started("benchmarks.publish", "send", address, str(count)):
        return asyncio.run(_read(address, seconds, data["router"]))


async def _read(address: str, seconds: float, router_pid: int) -> dict[str, Any]:
    late: list[float] = []
    loop = asyncio.get_running_loop()
    async with Fleet("bench/*/scan", router=address, depth=8) as fleet:
        until = loop.time() + _SETTLE_S
        began, own, router = 0.0, 0.0, 0.0
        async for each in fleet:
            now = loop.time()
            if now >= until:
                if began:
                    break
                began, until = now, now + seconds
                own, router, lost = time.process_time(), seconds_of(router_pid), fleet.lost + fleet.dropped
            elif began:
                late.append((time.time_ns() - each.sent_ns) * 1e-6)
        took = loop.time() - began
        return {
            "reader_cpu": 100 * (time.process_time() - own) / took,
            "router_cpu": 100 * (seconds_of(router_pid) - router) / took,
            "p50_ms": percentile(late, 50),
            "p99_ms": percentile(late, 99),
            "scans": len(late),
            "lost": fleet.lost + fleet.dropped - lost,
        }


async def _send(address: str, count: int) -> None:
    """Publish for ever; each publisher at its own moment."""
    buses = [await Bus.open(address) for _ in range(count)]
    outlets = [bus.sender(f"bench/{n}/scan", n.to_bytes(16, "little")) for n, bus in enumerate(buses)]
    message = encode_scan(_scan())
    loop = asyncio.get_running_loop()
    print("ready", flush=True)
    begin, number = loop.time(), 0
    while True:
        outlets[number % count].send(message)
        number += 1
        await asyncio.sleep(max(0.0, begin + number / (count * HERTZ) - loop.time()))


def _scan() -> Scan:
    angles = np.radians(np.linspace(0, 359.9, SAMPLES))
    return make_scan(-angles, 3.0, intensities=47, mode="DenseBoost", max_range=30.0)


@contextmanager
def _router(data: dict[str, Any] | None = None) -> Iterator[str]:
    """A router in a process of its own."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with started("benchmarks.publish", "router", address) as (process, _):
        if data is not None:
            data["router"] = process.pid
        yield address


def _route(address: str) -> None:
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([address]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with ExitStack() as stack:
        stack.enter_context(zenoh.open(config))
        print("ready", flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    if sys.argv[1] == "router":
        _route(sys.argv[2])
    else:
        asyncio.run(_send(sys.argv[2], int(sys.argv[3])))
