"""A program that scans is killed at a random moment: the next one opens the device at its first attempt.

SIGKILL leaves the program no time for anything, so the device goes on scanning, or holds a response that nobody has
read. With `guard=True` its guard leaves the device still and is gone, also where the next program comes while the
guard still holds the port, or where the program ends by itself. The moments are drawn from a seed; how busy the
machine is decides what the program does at that moment.
"""

import asyncio
import os
import random
import signal
import threading
import time

import pytest

import lidario
from lidario.port.diagnose import holders
from lidario.sim.serve import PtyServer
from tests.cli.processes import served
from tests.support.children import BOUND, UNDISTURBED, child, forget, guards_of, is_still, requests, until

pytestmark = pytest.mark.discards(
    "nobody knows what the killed program has just written, and which response it was waiting for"
)

LONGEST_S = 0.4
MOST = 20
"""How many times the rounds at most, until enough of the killed programs have scanned."""
PROGRAM = """
import asyncio, random, sys
import lidario

async def main():
    dice = random.Random(int(sys.argv[3]))
    async with lidario.open_lidar(sys.argv[1], family=sys.argv[2], guard=len(sys.argv) > 4) as lidar:
        while True:
            async with lidar.scans() as stream:
                for _ in range(dice.randrange(1, 4)):
                    await anext(stream)
            await dice.choice([lidar.get_health, lidar.get_info, lidar.get_modes, lidar.stop])()

asyncio.run(main())
"""


async def scan_once(path: str, family: str | None, *, guard: bool) -> lidario.Scan:
    async with lidario.open_lidar(path, family=family, guard=guard) as lidar:
        return await lidar.scan()


def kill_at_random(server: PtyServer, family: str, dice: random.Random, *, guard: bool) -> tuple[bool, float]:
    """Kill a program after its first request, or once it scans; whether it scanned, and how long that went on."""
    scans = dice.random() < 0.7
    forget(server)
    arguments = (server.path, family, str(dice.randrange(1000)), *["guard"] * guard)
    with child(UNDISTURBED + PROGRAM, *arguments) as process:
        until(lambda: requests(server) or process.poll() is not None)
        if scans:
            until(lambda: not is_still(server) or process.poll() is not None)
        time.sleep(dice.uniform(0.0, LONGEST_S))
        with server.lock:
            scanned = server.device.scanning
            process.kill()
            killed = time.monotonic()
        if guard:
            until(lambda: is_still(server))
        lasted = time.monotonic() - killed
        _, said = process.communicate()
    assert said == ""
    if guard and dice.random() < 0.5:
        # Else the next program finds the guard still at the port.
        until(lambda: not guards_of(process.pid))
        assert is_still(server), requests(server)[-12:]
    return scanned, lasted


KILLED = [
    *((model, guard) for model in ("rplidar-s2", "ydlidar-4ros") for guard in (False, True)),
    ("rplidar-a1", True),
]
"""The device, and whether the program has a guard."""


@pytest.mark.long
@pytest.mark.exhaustive("killed", sample=KILLED[:2], full=KILLED)
def test_killed_at_any_moment(killed: tuple[str, bool], rounds: int) -> None:
    model, guard = killed
    dice = random.Random(rounds)
    family = model.partition("-")[0]
    scanned = number = 0
    worst = []
    with served(model) as server:
        # How many programs come to scan before they are killed depends on how busy the machine is.
        while number < rounds or (scanned < rounds // 4 and number < MOST * rounds):
            number += 1
            was_scanning, lasted = kill_at_random(server, family, dice, guard=guard)
            scanned += was_scanning
            worst.append(lasted)
            known = family if dice.randrange(4) else None
            scan = asyncio.run(scan_once(server.path, known, guard=guard))
            assert len(scan.ranges) > 100, number
            # Nobody holds the port: neither the first guard nor that of this program.
            assert list(holders(server.path)) == []
            until(lambda: is_still(server), lambda: requests(server)[-5:])
    assert scanned >= rounds // 4
    half, most = sorted(worst)[len(worst) // 2], sorted(worst)[-len(worst) // 20]
    print(
        f"{model}: {scanned} of {number} scanned; still after {half:.3f} s (half), {most:.3f} s (19 of 20)", end=""
    )
    print(f", {max(worst):.3f} s (all)")


@pytest.mark.long
@pytest.mark.parametrize("real", [False, True], ids=["pseudo-terminal", "taken for a real port"])
def test_a_program_that_opens_the_port_meanwhile_waits(real: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A real port that somebody holds is not opened at all, since that would move its control lines."""
    if real:
        monkeypatch.setattr("lidario.port.serial.is_pseudo_terminal", lambda path: False)
    with (
        served("rplidar-s2") as server,
        child(UNDISTURBED + PROGRAM, server.path, "rplidar", "1", "guard") as process,
    ):
        until(lambda: not is_still(server))
        (guard,) = guards_of(process.pid)
        # It is made to stay at the port for a while longer.
        os.kill(guard, signal.SIGSTOP)
        process.kill()
        process.communicate()
        with monkeypatch.context() as patch:
            patch.setattr("lidario.port.guard.WAIT_S", 0.1)
            with pytest.raises(lidario.ConnectFailed, match=r"busy: held by PID .*lidario-guard"):
                asyncio.run(scan_once(server.path, "rplidar", guard=True))
        assert not is_still(server)
        # A busy machine may let the guard stand for longer than it is waited for.
        monkeypatch.setattr("lidario.port.guard.WAIT_S", BOUND)
        threading.Timer(0.2, os.kill, (guard, signal.SIGCONT)).start()
        scan = asyncio.run(scan_once(server.path, "rplidar", guard=True))
        assert len(scan.ranges) > 100


OPENS = """
import asyncio, gc, os, sys, warnings
import lidario
def open_it():
    return lidario.open_lidar(sys.argv[1], guard=True)
"""
ENDINGS = {
    "garbage": """
loop = asyncio.new_event_loop()
lidar = loop.run_until_complete(open_it())
scans = lidar.scans()
loop.run_until_complete(anext(scans))
loop.run_until_complete(scans.aclose())
del lidar, scans
for _ in range(3):
    gc.collect()
    loop.run_until_complete(asyncio.sleep(0.2))
loop.close()
""",
    "the loop was closed": """
loop = asyncio.new_event_loop()
lidar = loop.run_until_complete(open_it())
loop.run_until_complete(lidar.scan())
loop.close()
del lidar
gc.collect()
""",
    "never closed": """
warnings.simplefilter("ignore")  # of the loop
loop = asyncio.new_event_loop()
lidar = loop.run_until_complete(open_it())
loop.run_until_complete(lidar.scan())
""",
    "never closed without await": """
lidar = lidario.open_sync(sys.argv[1], guard=True)
lidar.scan()
""",
    "an exception": """
async def main():
    async with open_it() as lidar:
        await lidar.scan()
        raise SystemExit(0)
asyncio.run(main())
""",
}


@pytest.mark.long
@pytest.mark.exhaustive("ending", sample=["garbage", "never closed"], full=ENDINGS)
def test_a_program_that_ends_by_itself_leaves_none(ending: str) -> None:
    with served("rplidar-s2") as server:
        with child(UNDISTURBED + OPENS + ENDINGS[ending], server.path) as process:
            _, said = process.communicate()
            assert (process.returncode, said) == (0, "")
            until(lambda: not guards_of(process.pid))
        until(lambda: is_still(server))
