"""Simulated devices in a program that has more than 1024 descriptors open."""

from __future__ import annotations

import resource

import pytest

from tests.support.children import ended

SERVED = """
import asyncio, os, resource, sys
import lidario
from lidario.sim.serve import PtyServer, TcpServer, UdpServer

_, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (2000, hard))
kept = [os.open(os.devnull, os.O_RDONLY) for _ in range(1100)]

async def main():
    for kind, model in ((PtyServer, "rplidar-s2"), (TcpServer, "rplidar-s2"), (UdpServer, "rplidar-s2e")):
        with kind(lidario.simulate(model, spin_up=0)) as server:
            if kind is PtyServer:
                source = server.path
            else:
                source = f"{'tcp' if kind is TcpServer else 'udp'}://{server.address[0]}:{server.address[1]}"
            async with lidario.open_lidar(source, family="rplidar") as lidar:
                print(kind.__name__, len(await lidar.scan()) > 3000, flush=True)

asyncio.run(main())
"""


@pytest.mark.long
def test_devices_are_served_beyond_1023_descriptors() -> None:
    if resource.getrlimit(resource.RLIMIT_NOFILE)[1] < 2000:
        pytest.fail("this system allows fewer than 2000 descriptors: the test needs them")
    done = ended(SERVED)
    assert done.stdout.split("\n")[:3] == ["PtyServer True", "TcpServer True", "UdpServer True"], done.stderr
    assert done.returncode == 0, done.stderr
