"""A lidar before which an obstacle appears and goes, on a pseudo-terminal.

Two simulated devices get the same requests at the same times, and only one of them sees the obstacle. So their
bytes are the same but for those that show it. What is written is noted with its time, on the clock that all
processes
share: the last byte that shows the obstacle in the first revolution in which it is seen.

It prints the path to open, then a line of JSON for each time the obstacle was shown, and ends with its standard
input.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import select
import sys
import time
import tty
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidario import simulate

__all__ = ["HALF_WIDTH_DEG", "NEAR_MM", "main"]

NEAR_MM = 500.0
HALF_WIDTH_DEG = 1.0
_FAR_MM = 3000.0
_TICK_S = 0.0005
_SHOWN_REVOLUTIONS, _FREE_REVOLUTIONS = 1.5, (1.5, 2.5)


class Sight:
    """3 m all around, and an obstacle at `bearing_deg` from `since_s` to `until_s`."""

    def __init__(self, *, blind: bool) -> None:
        self._blind = blind
        self.bearing_deg = self.since_s = self.until_s = 0.0

    def ranges_mm(self, angles: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `lidario.WorldLike`."""
        ranges = np.full(len(angles), _FAR_MM)
        if not self._blind:
            off = np.abs((angles - self.bearing_deg + 180.0) % 360.0 - 180.0)
            ranges[(off < HALF_WIDTH_DEG) & (times >= self.since_s) & (times < self.until_s)] = NEAR_MM
        return ranges


def main() -> None:
    """Serve until the standard input ends."""
    model, hertz, seed = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    draw = random.Random(seed)
    sees, blind = Sight(blind=False), Sight(blind=True)
    devices: list[Any] = [simulate(model, world=world, spin_up=0.0, seed=1) for world in (sees, blind)]
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    print(os.ttyname(slave), flush=True)
    turn_s = 1.0 / hertz
    first_ns = seen_ns = 0
    while True:
        ready, _, _ = select.select([sys.stdin, master], [], [], _TICK_S)
        if sys.stdin in ready:
            return
        now = time.monotonic_ns()
        if master in ready:
            asked = os.read(master, 4096)
            for device in devices:
                device.receive(asked, now)
        data, other = (device.transmit(now) for device in devices)
        if data != other and (not first_ns or now - first_ns < turn_s * 5e8):
            first_ns, seen_ns = first_ns or now, time.monotonic_ns()
        if data:
            with contextlib.suppress(BlockingIOError):  # what the terminal cannot take is lost, as on a real line
                os.write(master, data)
        if devices[0].scanning and now * 1e-9 > sees.until_s + draw.uniform(*_FREE_REVOLUTIONS) * turn_s:
            if seen_ns:
                print(json.dumps({"seen_ns": seen_ns, "since_ns": round(sees.since_s * 1e9)}), flush=True)
            first_ns = seen_ns = 0
            sees.bearing_deg = draw.uniform(0.0, 360.0)
            sees.since_s = now * 1e-9 + draw.uniform(0.5, 1.5) * turn_s
            sees.until_s = sees.since_s + _SHOWN_REVOLUTIONS * turn_s


if __name__ == "__main__":
    main()
