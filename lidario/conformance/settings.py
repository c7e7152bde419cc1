"""Rules about what can be set, and about a program that is late."""

from __future__ import annotations

import asyncio

from lidario.conformance.bench import Bench
from lidario.conformance.flow import steady
from lidario.conformance.rule import Broken, Need, NotTried, Origin, Rule, known
from lidario.errors import RemoteProtocolError, StreamFailed, Unsupported

__all__ = ["PAUSE_S", "SETTINGS"]

PAUSE_S = 0.4
"""How long the program pauses: longer than the kernel's buffer lasts for the fastest device."""
LAPSE_S = 3.0
"""How long the manual gives a host that has fallen silent."""
LATE_S = 1.0
"""How much later the last packets may be read: half a second of buffers, and the device's own clock."""
SLOWER, FASTER = 0.8, 1.5
"""Shares of the usual speed, where the range allows it: not every device tells its true range."""
KEPT_S = 5.0
"""How long a stream is kept going: it would end after three seconds."""


@known(
    "A scan frequency that is set is reached within ten seconds, a slower one and a faster one.",
    Origin.MANUAL,
    "motor speed, or scan frequency; the measured speed is within 5 %",
    Need.SPEED,
    limit_s=60.0,
)
async def speed_is_reached(bench: Bench) -> str:
    """Set a slower and a faster one while scans come, and what was set before at the end."""
    lidar = bench.lidar
    slowest, fastest = await lidar.get_scan_frequency_range()
    took = list[str]()
    async with lidar.scans(depth=1) as scans:
        usual = (await steady(scans)).rpm / 60
        try:
            for share in (SLOWER, FASTER):
                hertz = min(max(share * usual, slowest), fastest)
                began = bench.now()
                await lidar.set_scan_frequency(hertz)
                took.append(f"{hertz:.1f} Hz in {bench.now() - began:.1f} s")
        except RemoteProtocolError as error:
            raise Broken(str(error)) from None
        finally:
            await lidar.set_scan_frequency(min(max(usual, slowest), fastest), verify=False)
    return ", ".join(took)


@known(
    "With power-down protection a stream goes on while its host repeats what keeps it going.",
    Origin.MANUAL,
    "power-down protection",
    limit_s=30.0,
)
async def protection_keeps(bench: Bench) -> str:
    """Read scans for longer than the device waits for its host."""
    await bench.lidar.set_power_down_protection(True)
    try:
        before, count = bench.lidar.stats, 0
        async with bench.lidar.scans(depth=2) as scans:
            async with asyncio.timeout(KEPT_S + 10):
                began: float | None = None
                async for _ in scans:
                    began = began or bench.now()
                    count += 1
                    if bench.now() - began > KEPT_S:
                        break
            after = bench.lidar.stats
        restarts = after.restarts - before.restarts
        if restarts:
            raise Broken(f"the stream ended {restarts} times within {KEPT_S:g} s")
        return f"{count} scans, {after.keepalives - before.keepalives} requests"
    except StreamFailed as error:
        raise Broken(str(error)) from None
    finally:
        await bench.lidar.set_power_down_protection(False)


@known(
    "With power-down protection a device whose host falls silent stops after three seconds.",
    Origin.MANUAL,
    "power-down protection",
    limit_s=30.0,
)
async def protection_stops(bench: Bench) -> str:
    """Start a stream and say nothing more."""
    await bench.lidar.set_power_down_protection(True)
    try:
        flow = await bench.flow(await bench.typical())
        began = flow.began + flow.announced_s
        await asyncio.sleep(max(0.0, began + LAPSE_S + LATE_S + 1.0 - bench.now()))
        lasted = bench.last_in - began
        await bench.rest()
    finally:
        await bench.lidar.set_power_down_protection(False)
    if lasted > LAPSE_S + LATE_S:
        raise Broken(f"packets still came {lasted:.1f} s behind the last request")
    return f"last packets {lasted:.1f} s behind the last request"


@known(
    "When the program pauses, no revolution is lost in silence: numbers and time stamps tell of each.",
    Origin.PROMISE,
    "what you can rely on: losses counted",
)
async def pause_is_told(bench: Bench) -> str:
    """Block the event loop between two scans, then count."""
    async with bench.lidar.scans(depth=64) as scans:
        before = await steady(scans)
        first = last = await anext(scans)
        turn_ns = (first.stamp_ns - before.stamp_ns) / (first.seq - before.seq)
        bench.pause(PAUSE_S)
        for _ in range(4):
            last = await anext(scans)
    turns = (last.stamp_ns - first.stamp_ns) / turn_ns
    told = last.seq - first.seq
    if abs(turns - told) > max(0.5, 0.1 * told):
        raise Broken(f"{turns:.1f} revolutions passed, and {told} are told of")
    return f"{told} revolutions in {turns:.1f} turns"


@known(
    "Several readers get the same scans.",
    Origin.PROMISE,
    "what you can rely on: several tasks at once",
)
async def readers_agree(bench: Bench) -> str:
    """Read twice at once."""
    async with bench.lidar.scans(depth=8) as one, bench.lidar.scans(depth=8) as two:
        for _ in range(3):
            left, right = await anext(one), await anext(two)
            while left.seq < right.seq:
                left = await anext(one)
            if left.seq != right.seq or left.stamp_ns != right.stamp_ns or len(left) != len(right):
                raise Broken(f"one reader got revolution {left.seq}, the other one {right.seq}")
    return "3 scans each"


@known(
    "A scan mode that does not exist is refused, and the session goes on.",
    Origin.PROMISE,
    "a wrong argument says so",
)
async def unknown_mode_is_refused(bench: Bench) -> str:
    """Ask for a mode of another name."""
    try:
        await bench.lidar.scan("no mode has this name")
    except Unsupported:
        pass
    else:
        raise Broken("a scan came of a mode that does not exist")
    if not bench.lidar.is_connected:
        raise NotTried("the line to the device is lost")
    scan = await bench.lidar.scan()
    return f"then {len(scan)} samples"


SETTINGS: tuple[Rule, ...] = (
    speed_is_reached,
    protection_keeps,
    protection_stops,
    pause_is_told,
    readers_agree,
    unknown_mode_is_refused,
)
"""All of them, in the order in which they are tried."""
