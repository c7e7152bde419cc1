"""A program that scans is killed at a random moment: the next one opens the device at its first attempt.

SIGKILL leaves the program no time for anything, so the device goes on scanning, or holds a response that nobody has
read. The moments are drawn from a seed; how busy the machine is decides what the program does at that moment.
"""

from __future__ import annotations

import asyncio
import random
import time

import pytest

import lidario
from lidario.sim.serve import PtyServer
from tests.cli.processes import served
from tests.support.children import UNDISTURBED, child, forget, is_still, requests, until

pytestmark = pytest.mark.discards("a new program cannot know which response the killed one was waiting for")

LONGEST_S = 0.4
MOST = 20
"""How many times the rounds at most, until enough of the killed programs have left the device scanning."""
PROGRAM = """
import asyncio, random, sys
import lidario

async def main():
    dice = random.Random(int(sys.argv[3]))
    async with lidario.open_lidar(sys.argv[1], family=sys.argv[2]) as lidar:
        while True:
            async with lidar.scans() as stream:
                for _ in range(dice.randrange(1, 4)):
                    await anext(stream)
            await dice.choice([lidar.get_health, lidar.get_info, lidar.get_modes, lidar.stop])()

asyncio.run(main())
"""


def kill_at_random(server: PtyServer, family: str, dice: random.Random) -> bool:
    """Kill a program after its first request, or once it scans; whether it has left the device scanning."""
    scans = dice.random() < 0.5
    forget(server)
    with child(UNDISTURBED + PROGRAM, server.path, family, str(dice.randrange(1000))) as process:
        until(lambda: requests(server) or process.poll() is not None)
        if scans:
            until(lambda: not is_still(server) or process.poll() is not None)
        time.sleep(dice.uniform(0.0, LONGEST_S))
        process.kill()
        _, said = process.communicate()
    assert said == ""
    return not is_still(server)


async def scan_once(path: str, family: str | None, *, guard: bool = False) -> lidario.Scan:
    async with lidario.open_lidar(path, family=family, guard=guard) as lidar:
        return await lidar.scan()


@pytest.mark.long
@pytest.mark.exhaustive("model", sample=["rplidar-s2"], full=["rplidar-s2", "ydlidar-4ros"])
def test_the_next_program_opens_it_at_once(model: str, rounds: int) -> None:
    dice = random.Random(rounds)
    family = model.partition("-")[0]
    left_scanning = number = 0
    with served(model) as server:
        # How many programs come to scan before they are killed depends on how busy the machine is.
        while number < rounds or (left_scanning < rounds // 4 and number < MOST * rounds):
            number += 1
            left_scanning += kill_at_random(server, family, dice)
            known = family if dice.randrange(4) else None
            scan = asyncio.run(scan_once(server.path, known))
            assert len(scan.ranges) > 100, number
            until(lambda: is_still(server), lambda: requests(server)[-5:])
    assert left_scanning >= rounds // 4
