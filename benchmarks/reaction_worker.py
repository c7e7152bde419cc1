"""The two processes of `benchmarks.reaction`: ``python -m benchmarks.reaction_worker device`` or ``reader '{…}'``.

The device is a simulated one on a pseudo-terminal. In its world, something narrow comes near now and then, anywhere
around. The device notes each delivery that it writes, and when. So the packets that show an obstacle are found in
the very bytes that were written, without the decoders that are measured. A response ends with its standard input.

The reader is a robot's program: it calls `stop` when something is near.
"""

from __future__ import annotations

import asyncio
import json
import random
import sys
import time
from bisect import bisect_left
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

import lidario
from benchmarks.usage import Usage
from lidario.families.rplidar.simulated.device import SimulatedRplidar
from lidario.families.rplidar.simulated.profiles import PROFILES
from lidario.sim.serve import PtyServer

NEAR_M = 0.5
_FAR_MM, _NEAR_MM = 3000.0, 400.0
_WIDTH_DEG = 4.0
_EVERY_S, _STAYS_S = 0.55, 0.25
_PACKET, _HEAD, _ANNOUNCEMENT = 84, 4, 7
_SECTOR_DEG = 45
_ANNOUNCED = b"\xa5\x5a"


class _Surprises:
    """A round room in which something narrow is near for a quarter of a second out of every half."""

    def __init__(self) -> None:
        self._chance = random.Random(1)
        self._known: dict[int, tuple[float, float]] = {}

    def ranges_mm(self, angles_deg_clockwise: npt.ArrayLike, t_seconds: npt.ArrayLike) -> npt.NDArray[np.float64]:
        angles = np.asarray(angles_deg_clockwise, np.float64)
        times = np.broadcast_to(np.asarray(t_seconds, np.float64), angles.shape)
        ranges = np.full(angles.shape, _FAR_MM)
        for number in np.unique((times // _EVERY_S).astype(int)).tolist():
            if number not in self._known:
                self._known[number] = self._chance.uniform(0.0, 360.0), self._chance.uniform(0.0, 0.2)
            bearing, delay = self._known[number]
            since = times - number * _EVERY_S - delay
            near = (since >= 0.0) & (since < _STAYS_S) & ((angles - bearing) % 360.0 < _WIDTH_DEG)
            ranges[near] = _NEAR_MM
        return ranges


class _Noting(PtyServer):
    """Notes what it writes, and when."""

    def __init__(self, device: SimulatedRplidar, chunk: int) -> None:
        self.written: list[bytes] = []
        self.times: list[int] = []
        super().__init__(device, chunk=chunk)

    def _send(self, data: bytes) -> int:
        now = time.monotonic_ns()
        taken = super()._send(data)
        if not self.lost and taken == len(data):
            # Behind a loss, packets do not stand where they are expected.
            self.written.append(data)
            self.times.append(now)
        return taken


def _report(server: _Noting) -> dict[str, list[int]]:
    """When which bytes were written.

    Returns:
        ``shown``: for each obstacle, the last byte that shows it for the first time; ``ends``: for each sector, the
        last byte of the packet that begins behind it; ``noted``: the last of all.
    """
    data = b"".join(server.written)
    ends = np.cumsum([len(each) for each in server.written]).tolist()
    begin = data.index(_ANNOUNCED + bytes([_PACKET])) + _ANNOUNCEMENT
    count = (len(data) - begin) // _PACKET
    packets = np.frombuffer(data, np.uint8, count * _PACKET, begin).reshape(count, _PACKET)
    words = np.ascontiguousarray(packets).view("<u2")
    sectors = (words[:, 1] & 0x7FFF) // (_SECTOR_DEG * 64)
    ended = [
        server.times[bisect_left(ends, begin + (packet + 1) * _PACKET)]
        for packet in ((sectors[1:] != sectors[:-1]).nonzero()[0] + 1).tolist()
    ]
    shown = _shown_ns(server, ends, begin, words[:, _HEAD // 2 :])
    return {"shown": shown, "ends": ended, "noted": [server.times[-1]]}


def _shown_ns(server: _Noting, ends: list[int], begin: int, distances: npt.NDArray[np.uint16]) -> list[int]:
    near = (distances > 0) & (distances < 1000 * NEAR_M)
    shows = np.flatnonzero(near.any(axis=1)).tolist()
    shown: list[int] = []
    last_ns, before = -(10**12), -10
    for packet in shows:
        at_ns = server.times[bisect_left(ends, begin + (packet + 1) * _PACKET)]
        if packet == before + 1 and shown and at_ns - shown[-1] < 20_000_000 and last_ns == shown[-1]:
            shown[-1] = last_ns = at_ns
        elif at_ns - last_ns > 280_000_000:
            shown.append(at_ns)
            last_ns = at_ns
        before = packet
    return shown


def device() -> None:
    """Serve until standard input ends."""
    # The real one turns at 8 to 20 Hz; other models at 7.
    made = SimulatedRplidar(replace(PROFILES["rplidar-s2"], speed_conf=(600, 400, 1200)), world=_Surprises())
    made.spin_up_s = 0.0
    with _Noting(made, chunk=64) as server:
        print(server.path, flush=True)
        sys.stdin.readline()
        print(json.dumps(_report(server)), flush=True)


async def read(task: dict[str, Any]) -> dict[str, Any]:
    """Read for a while; tell when `stop` was called, and what reading cost."""
    stops: list[int] = []
    arrivals: list[int] = []
    async with lidario.open_lidar(task["path"]) as lidar:
        await lidar.set_scan_frequency(task["hertz"], verify=False)
        stream: Any = lidar.sectors() if task["how"] == "sectors" else lidar.scans()
        await anext(stream)
        usage = Usage()
        while usage.seconds() < task["window_s"]:
            record = await anext(stream)
            arrivals.append(time.monotonic_ns())
            nearest = record.nearest()
            if nearest and nearest.range < NEAR_M:
                stops.append(time.monotonic_ns())
        used = usage.figures()
        await stream.aclose()
    return {"stops": stops, "arrivals": arrivals, **used}


def main(words: list[str]) -> None:
    """Be one of the two."""
    if words[0] == "device":
        device()
    else:
        print(json.dumps(asyncio.run(read(json.loads(words[1])))))


if __name__ == "__main__":
    main(sys.argv[1:])
