"""Rules about what can be set, and about a program that is late."""

import asyncio
import math

from lidario.conformance.bench import Bench
from lidario.conformance.flow import steady
from lidario.conformance.rule import Broken, Need, Origin, known
from lidario.errors import RemoteProtocolError, StreamFailed

PAUSE_S = 0.4  # how long the program pauses: longer than the kernel's buffer lasts for the fastest device
LAPSE_S = 3.0  # how long the manual gives a host that has fallen silent
LATE_S = 1.0  # how much later the last packets may be read: half a second of buffers, and the device's own clock
SLOWER, FASTER = 0.8, 1.5
"""Shares of the usual speed, where the range allows it: not every device tells its true range."""
KEPT_S = 5.0  # how long a stream is kept going: it would end after three seconds
KEPT_SHARE = 0.9


@known(Origin.MANUAL, "motor speed, or scan frequency; the measured speed is within 5 %", Need.SPEED, limit_s=60.0)
async def speed_is_reached(bench: Bench) -> str:
    """A scan frequency that is set is reached within ten seconds, a slower one and a faster one."""
    lidar = bench.lidar
    slowest, fastest = await lidar.get_scan_frequency_range()
    took = list[str]()
    async with lidar.scans(depth=1) as scans:
        usual = (await steady(scans)).rpm / 60
        if math.isnan(usual):
            raise Broken("no speed could be measured")
        try:
            for share in (SLOWER, FASTER):
                hertz = min(max(share * usual, slowest), fastest)
                began = bench.now()
                await lidar.set_scan_frequency(hertz)
                bench.measured(f"change to {hertz:.1f} Hz", bench.now() - began, "s")
                took.append(f"{hertz:.1f} Hz in {bench.now() - began:.1f} s")
        except RemoteProtocolError as error:
            raise Broken(str(error)) from None
        finally:
            await lidar.set_scan_frequency(min(max(usual, slowest), fastest), verify=False)
    return ", ".join(took)


@known(Origin.MANUAL, "power-down protection", limit_s=30.0)
async def protection_keeps(bench: Bench) -> str:
    """With power-down protection a stream goes on while its host repeats what keeps it going."""
    await bench.lidar.set_power_down_protection(True)
    try:
        async with bench.lidar.scans(depth=16) as scans:
            first = last = await steady(scans)
            if math.isnan(first.rpm):
                raise Broken("no speed can be told: the stream ends again and again")
            before, turn_ns = bench.lidar.stats, 60e9 / first.rpm
            while last.stamp_ns - first.stamp_ns < KEPT_S * 1e9:
                last = await anext(scans)
            after = bench.lidar.stats
        came, due = after.scans - before.scans, (last.stamp_ns - first.stamp_ns) / turn_ns
        if came < KEPT_SHARE * due or after.restarts > before.restarts:
            raise Broken(f"{came} scans came in {KEPT_S:g} s, not {due:.0f}: the stream ended meanwhile")
        requests = after.keepalives - before.keepalives
        bench.measured(f"requests that keep it going, in {KEPT_S:g} s", requests, "")
        return f"{came} scans, {requests} requests"
    except StreamFailed as error:
        raise Broken(str(error)) from None
    finally:
        await bench.lidar.set_power_down_protection(False)


@known(Origin.MANUAL, "power-down protection", limit_s=30.0)
async def protection_stops(bench: Bench) -> str:
    """With power-down protection a device whose host falls silent stops after three seconds."""
    await bench.lidar.set_power_down_protection(True)
    try:
        flow = await bench.flow(await bench.typical())
        began = flow.began + flow.announced_s
        await asyncio.sleep(max(0.0, began + LAPSE_S + LATE_S + 1.0 - bench.now()))
        lasted = bench.last_in - began
        await bench.rest()
    finally:
        await bench.lidar.set_power_down_protection(False)
    bench.measured("stream without a request", lasted, "s")
    if lasted > LAPSE_S + LATE_S:
        raise Broken(f"packets still came {lasted:.1f} s behind the last request")
    return f"last packets {lasted:.1f} s behind the last request"


@known(Origin.PROMISE, "what you can rely on: losses counted")
async def pause_is_told(bench: Bench) -> str:
    """When the program pauses, no revolution is lost in silence: numbers and time stamps tell of each."""
    async with bench.lidar.scans(depth=64) as scans:
        before = await steady(scans)
        first = last = await anext(scans)
        turn_ns = (first.stamp_ns - before.stamp_ns) / (first.seq - before.seq)
        bench.pause(PAUSE_S)
        for _ in range(4):
            last = await anext(scans)
    turns = (last.stamp_ns - first.stamp_ns) / turn_ns
    told = last.seq - first.seq
    bench.measured(f"revolutions told of around a pause of {PAUSE_S:g} s", told, "")
    bench.measured(f"revolutions that passed around a pause of {PAUSE_S:g} s", turns, "")
    if abs(turns - told) > max(0.5, 0.1 * told):
        raise Broken(f"{turns:.1f} revolutions passed, and {told} are told of")
    return f"{told} revolutions in {turns:.1f} turns"
