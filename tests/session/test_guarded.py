"""A program with `guard=True` is killed at a random moment: its guard leaves the device still and is gone.

The next program opens the device at its first attempt, also while the guard still holds the port. Without the guard
the device would go on: `tests/session/test_killed.py` counts how often it does.
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

import lidario
from lidario.port.diagnose import holders
from lidario.sim.serve import PtyServer
from tests.cli.processes import served
from tests.session.test_killed import MOST, PROGRAM, scan_once
from tests.support.children import UNDISTURBED, child, forget, requests, until
from tests.support.guards import guards_of, is_left_still

pytestmark = pytest.mark.discards(
    "a guard cannot know what the killed program has just written, so it writes again"
)

MODELS = ["rplidar-s2", "ydlidar-4ros", "rplidar-a1"]
LONGEST_S = 0.4
GUARDED = PROGRAM.replace("family=sys.argv[2]", "family=sys.argv[2], guard=True")


def kill_at_random(server: PtyServer, family: str, dice: random.Random) -> tuple[bool, float]:
    """Kill a program after its first request, or once it scans; whether it scanned, and how long that went on."""
    scans = dice.random() < 0.7
    forget(server)
    with child(UNDISTURBED + GUARDED, server.path, family, str(dice.randrange(1000))) as process:
        until(lambda: requests(server) or process.poll() is not None)
        if scans:
            until(lambda: not is_left_still(server) or process.poll() is not None)
        time.sleep(dice.uniform(0.0, LONGEST_S))
        with server.lock:
            scanned = server.device.scanning
            process.kill()
            killed = time.monotonic()
        until(lambda: is_left_still(server))
        lasted = time.monotonic() - killed
        _, said = process.communicate()
    assert said == ""
    if dice.random() < 0.5:
        # Else the next program finds the guard still at the port.
        until(lambda: not guards_of(process.pid))
        assert is_left_still(server), requests(server)[-12:]
    return scanned, lasted


@pytest.mark.long
@pytest.mark.exhaustive("model", sample=MODELS[:1], full=MODELS)
def test_killed_at_any_moment_it_leaves_the_device_still(model: str, rounds: int) -> None:
    dice = random.Random(rounds)
    family = model.partition("-")[0]
    scanned = number = 0
    worst = []
    with served(model) as server:
        while number < rounds or (scanned < rounds // 4 and number < MOST * rounds):
            number += 1
            was_scanning, lasted = kill_at_random(server, family, dice)
            scanned += was_scanning
            worst.append(lasted)
            known = family if dice.randrange(4) else None
            scan = asyncio.run(scan_once(server.path, known, guard=True))
            assert len(scan.ranges) > 100, number
            # Nobody holds the port: neither the first guard nor that of this program.
            assert list(holders(server.path)) == []
            until(lambda: is_left_still(server), lambda: requests(server)[-5:])
    assert scanned >= rounds // 4
    print(f"{model}: {scanned} of {number} scanned; still after {sorted(worst)[len(worst) // 2]:.3f} s", end=" ")
    print(f"(half), {sorted(worst)[-len(worst) // 20]:.3f} s (19 of 20), {max(worst):.3f} s (all)")


@pytest.mark.long
@pytest.mark.parametrize("real", [False, True], ids=["pseudo-terminal", "taken for a real port"])
def test_a_program_that_opens_the_port_meanwhile_waits(real: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A real port that somebody holds is not opened at all, since that would move its control lines."""
    if real:
        monkeypatch.setattr("lidario.port.serial.is_pseudo_terminal", lambda path: False)
    with served("rplidar-s2") as server, child(UNDISTURBED + GUARDED, server.path, "rplidar", "1") as process:
        until(lambda: not is_left_still(server))
        (guard,) = guards_of(process.pid)
        # It is made to stay at the port for a while longer.
        os.kill(guard, signal.SIGSTOP)
        process.kill()
        process.communicate()
        with pytest.raises(lidario.ConnectFailed, match=r"busy: held by PID .*lidario-guard"), soon(monkeypatch):
            asyncio.run(scan_once(server.path, "rplidar", guard=True))
        assert not is_left_still(server)
        threading.Timer(0.2, os.kill, (guard, signal.SIGCONT)).start()
        scan = asyncio.run(scan_once(server.path, "rplidar", guard=True))
        assert len(scan.ranges) > 100


@contextmanager
def soon(patch: pytest.MonkeyPatch) -> Iterator[None]:
    """A guard is waited for shortly."""
    with patch.context() as shortly:
        shortly.setattr("lidario.port.serial.WAIT_S", 0.1)
        yield
