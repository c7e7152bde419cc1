"""The reaction benchmark counts what it says: which bytes show the obstacle, and which stop belongs to them."""

from __future__ import annotations

import numpy as np

from benchmarks.reaction import paired
from benchmarks.reaction_player import HALF_WIDTH_DEG, NEAR_MM, Sight
from lidario import simulate

MS = 1_000_000


def test_a_stop_belongs_to_the_obstacle_that_was_shown_before_it() -> None:
    shown = [{"since_ns": at * MS, "seen_ns": (at + 20) * MS} for at in (0, 100, 500, 3000, 9000)]
    stops = [50 * MS, 125 * MS, 126 * MS, 580 * MS, 5000 * MS]
    # The first one was there before the reader, the last one behind its end; the one at 3 s was seen too late.
    assert paired(shown, stops) == ([5.0, 60.0], 1)
    assert paired(shown, []) == ([], 0)


def test_only_the_bytes_that_show_the_obstacle_differ() -> None:
    sees, blind = Sight(blind=False), Sight(blind=True)
    devices = [simulate(world=world, spin_up=0, seed=1) for world in (sees, blind)]
    sees.bearing_deg, sees.since_s, sees.until_s = 90.0, 1.0, 1.35
    different = []
    for tick in range(1500):
        now = tick * MS
        if tick == 500:
            for device in devices:
                device.receive(bytes.fromhex("a520"), now)  # SCAN
        data, other = (device.transmit(now) for device in devices)
        assert len(data) == len(other)
        if data != other:
            different.append(tick)
    # Once a revolution of 100 ms, for about as long as the beam takes to pass it.
    starts = [tick for tick in different if tick - 1 not in different]
    assert len(starts) in (3, 4)
    assert all(96 <= step <= 104 for step in np.diff(starts))
    assert len(different) <= 3 * len(starts)
    assert sees.ranges_mm(np.array([90.0 + HALF_WIDTH_DEG / 2]), np.array([1.1]))[0] == NEAR_MM
    assert sees.ranges_mm(np.array([90.0]), np.array([1.4]))[0] > NEAR_MM
