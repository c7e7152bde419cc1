"""A line that loses everything for a while, just when the device is told to stop: it is still all the same.

Silence behind a STOP proves nothing there. A question does that is answered while nothing else comes.
"""

import asyncio
import time
from collections.abc import Callable
from typing import Any

import pytest

from lidario import open_lidar
from lidario.sim.serve import PtyServer, TcpServer
from tests.support.devices import Rig, is_off, left_still, make_rig, names
from tests.support.loop import now

MODELS = ("rplidar-s2", "rplidar-a1", "rplidar-a2", "ydlidar-4ros", "hokuyo-urg04lx")
LOSES = {"all": (True, True), "requests": (True, False), "responses": (False, True)}
stoppable = pytest.mark.parametrize("rig", MODELS, indirect=True)


def cut(device: Any, clock: Callable[[], float], seconds: float, *, requests: bool, responses: bool) -> None:
    """From now on the line to the device loses what goes this way, or that, for so many seconds."""
    hear, send, ends = device.receive, device.transmit, clock() + seconds

    def receive(data: bytes, at_ns: int) -> None:
        if not (requests and clock() < ends):
            hear(data, at_ns)

    def transmit(at_ns: int) -> bytes:
        sent = send(at_ns)
        return b"" if responses and clock() < ends else sent

    device.receive, device.transmit = receive, transmit


@stoppable
@pytest.mark.parametrize("loses", LOSES)
@pytest.mark.parametrize("outage_s", [0.2, 0.5, 1.5])
async def test_one_is_still_whose_line_is_dead_when_it_is_closed(rig: Rig, loses: str, outage_s: float) -> None:
    requests, responses = LOSES[loses]
    async with rig.read():
        cut(rig.device, now, outage_s, requests=requests, responses=responses)
        began = now()
    assert left_still(rig), names(rig)[-6:]
    assert now() - began < outage_s + 1.0


@pytest.mark.long
@pytest.mark.real_time
@pytest.mark.parametrize("server", [PtyServer, TcpServer])
@pytest.mark.parametrize("model", ["rplidar-s2", "rplidar-a1", "ydlidar-4ros"])
@pytest.mark.parametrize("outage_s", [0.2, 0.5, 1.0])
async def test_one_at_a_real_line_too(server: Any, model: str, outage_s: float) -> None:
    rig = make_rig(model)
    device = rig.device
    with server(device) as served:
        way = f"serial://{served.path}" if server is PtyServer else "tcp://{}:{}".format(*served.address)
        async with open_lidar(way, family=rig.family) as lidar:
            await anext(lidar.scans())
            with served.lock:
                cut(device, time.monotonic, outage_s, requests=True, responses=True)
        await asyncio.sleep(0.1)  # what was written last has arrived
        with served.lock:
            # A pseudo-terminal has no DTR.
            assert not device.scanning
            assert model == "rplidar-a1" or is_off(device)
