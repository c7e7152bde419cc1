"""Ctrl-C at random moments ends a program that uses `open_sync`, and the device is still each time.

The program is a process of its own; the simulated device is in this one, on a pseudo-terminal, and tells whether it
was left still. Two hundred moments, a hundred for each model, take a few minutes:
``python -m pytest -n 2 tests/session/test_ctrl_c_sync.py --rounds 100``.
"""

from __future__ import annotations

import random
import signal
import time
from functools import partial

import pytest

from lidario.sim.serve import PtyServer
from tests.cli.processes import served
from tests.support.children import child, forget, is_still, line_of, requests, until

PROGRAM = """
import sys
import lidario
from lidario.blocking import open_sync

print("ready", flush=True)
with open_sync(sys.argv[1]) as lidar:
    while True:
        lidar.scan()
        for sector in lidar.sectors():
            if sector.is_last:
                break
        lidar.get_health()
        with lidar.scans() as scans:
            next(scans)
"""
LONGEST_S = 1.5
"""Opening takes 0.2 s, and one way through the loop 0.7 s."""


@pytest.mark.long
@pytest.mark.exhaustive("rounds", sample=[3], full=[5])
@pytest.mark.exhaustive("model", sample=["rplidar-s2"], full=["rplidar-s2", "ydlidar-4ros"])
def test_the_device_is_still_after_ctrl_c(model: str, rounds: int, request: pytest.FixtureRequest) -> None:
    rounds = request.config.getoption("--rounds") or rounds
    chance = random.Random(model)
    with served(model) as server:
        assert isinstance(server, PtyServer)
        moved = 0
        for number in range(rounds):
            forget(server)
            with child(PROGRAM, server.path) as process:
                assert line_of(process).strip() == "ready"
                moment = chance.uniform(0.0, LONGEST_S)
                time.sleep(moment)
                process.send_signal(signal.SIGINT)
                _, said = process.communicate(timeout=30)
            assert process.returncode == -signal.SIGINT, (number, moment, said)
            assert said.rstrip().endswith("KeyboardInterrupt"), (number, moment, said)
            until(partial(is_still, server), partial(requests, server))
            moved += any("scan" in each.name for each in requests(server))
        # Most of the moments are such that there was something to stop.
        assert moved >= rounds // 3
