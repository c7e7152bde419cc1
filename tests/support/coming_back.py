"""What tests of coming back have in common: moments on the way, and the first scan behind a moment."""

from __future__ import annotations

import asyncio

from lidario import Scan, ScanStream
from tests.support.cable import Cable

PROMISE_S = 2.0
"""Longest time from the moment at which the device responds again to the next scan."""
ON_THE_WAY_S = [0.001, 0.02, 0.045, 0.06, 0.08, 0.15]
"""Moments after an attempt has begun: it is asked what it is, then how it is, then it scans."""
MODES = {"rplidar": "Standard", "ydlidar": None}


async def next_attempt(cable: Cable, after_s: float) -> None:
    """Return so long after the next attempt to reach the device was begun."""
    attempts = len(cable.attempts)
    async with asyncio.timeout(5.0):
        while len(cable.attempts) == attempts:
            await asyncio.sleep(0.001)
    await asyncio.sleep(after_s)


async def next_after(stream: ScanStream, moment: float) -> Scan:
    """The first scan that was measured after `moment`."""
    while True:
        scan = await asyncio.wait_for(anext(stream), 30.0)
        if scan.stamp_ns > moment * 1e9:
            return scan


def causes(error: BaseException) -> list[BaseException]:
    found = []
    cause = error.__cause__
    while cause is not None:
        found.append(cause)
        cause = cause.__cause__
    return found
