"""A forked child ends; its parent's lidar goes on."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.support.devices import make_rig, names
from tests.support.ports import PATIENCE_S
from tests.support.speeds import SpeedPtyServer

ROOT = Path(__file__).parent.parent.parent

INSIDE = """
import asyncio, os, sys, lidario

async def main():
    async with lidario.open_lidar(sys.argv[1]) as lidar:
        async with lidar.scans() as stream:
            await anext(stream)
            child = os.fork()
            if child == 0:
                sys.exit(7)
            while os.waitpid(child, os.WNOHANG)[0] == 0:
                await asyncio.sleep(0.001)
            for _ in range(5):
                await anext(stream)
            print("interruptions", lidar.stats.interruptions, flush=True)
            sys.stdin.readline()

asyncio.run(main())
"""

BETWEEN = """
import asyncio, gc, os, sys, lidario

loop = asyncio.new_event_loop()
lidar = loop.run_until_complete(lidario.open_lidar(sys.argv[1]).__aenter__())
stream = lidar.scans()
loop.run_until_complete(stream.__anext__())
child = os.fork()
if child == 0:
    del lidar, stream
    gc.collect()
    sys.exit(7)
os.waitpid(child, 0)
for _ in range(5):
    loop.run_until_complete(stream.__anext__())
print("interruptions", lidar.stats.interruptions, flush=True)
sys.stdin.readline()
loop.run_until_complete(lidar.close())
loop.close()
"""


@pytest.mark.long
@pytest.mark.parametrize("program", [INSIDE, BETWEEN], ids=["inside the running loop", "between two runs of it"])
def test_the_exit_of_a_forked_child_stops_nothing(program: str) -> None:
    rig = make_rig("rplidar")
    with (
        SpeedPtyServer(rig.device) as server,
        subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", program, server.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        ) as process,
    ):
        assert process.stdout is not None
        # A parent whose lidar was stopped waits for ever.
        limit = threading.Timer(PATIENCE_S, process.kill)
        limit.start()
        told = process.stdout.readline()
        limit.cancel()
        with server.lock:
            scanning, log = rig.device.scanning, names(rig)
        _, errors = process.communicate("\n", timeout=PATIENCE_S)
        assert told == "interruptions 0\n", errors
        assert scanning
        # Opening stops it, on a busy machine more than once; after that only the close does.
        assert "stop" not in log[log.index("express_scan") :]
        assert process.returncode == 0, errors
        with server.lock:
            assert not rig.device.scanning
