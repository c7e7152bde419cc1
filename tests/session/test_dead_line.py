"""A line that loses everything for a while, just when the device is told to stop: it is still all the same.

Silence behind a STOP proves nothing there. A question does that is answered while nothing else comes.
"""

import asyncio
from itertools import product
from typing import Any

import pytest

from lidario import StreamFailed, open_lidar
from lidario.sim.serve import PtyServer, TcpServer
from tests.support.devices import Rig, in_turns, is_off, left_still, make_rig, names
from tests.support.loop import now
from tests.support.times import takes

pytestmark = pytest.mark.discards("stop requests and questions are tried while the line loses what goes one way")

MODELS = ("rplidar-s2", "rplidar-a1", "rplidar-a2", "ydlidar-4ros", "hokuyo-urg04lx")
LOSES = {"all": (True, True), "requests": (True, False), "responses": (False, True)}


def cut(device: Any, seconds: float, loses: str = "all") -> None:
    """From now on the line to the device loses what goes this way, or that, for so many seconds."""
    hear, send, ends = device.receive, device.transmit, now() + seconds
    requests, responses = LOSES[loses]

    def receive(data: bytes, at_ns: int) -> None:
        if not (requests and now() < ends):
            hear(data, at_ns)

    def transmit(at_ns: int) -> bytes:
        sent = send(at_ns)
        return b"" if responses and now() < ends else sent

    device.receive, device.transmit = receive, transmit


@pytest.mark.parametrize("rig", MODELS, indirect=True)
@pytest.mark.exhaustive(("loses", "outage_s"), sample=list(product(LOSES, (0.2, 0.5, 1.5))))
async def test_one_is_still_whose_line_is_dead_when_it_is_closed(rig: Rig, loses: str, outage_s: float) -> None:
    async with rig.read() as (lidar, _):
        cut(rig.device, outage_s, loses)
        with takes(outage_s + 1.0):
            await lidar.close()
    assert left_still(rig), names(rig)[-6:]


@pytest.mark.parametrize("loses", ["all", "requests"])
async def test_one_that_is_left_while_its_line_is_dead_is_stopped_behind_that(rig: Rig, loses: str) -> None:
    """Where nothing comes from it meanwhile, it is seen still; else it goes on sending, and is given up."""
    outage_s = 0.5 if loses == "all" else 0.3
    async with rig.open() as lidar:
        for _ in range(2):
            stream = lidar.scans()
            await anext(stream)
            cut(rig.device, outage_s, loses)
            await stream.aclose()
            await asyncio.sleep(outage_s)
            assert rig.device.scanning
            await asyncio.sleep(3.0)
            assert left_still(rig), names(rig)[-6:]


async def test_the_motor_is_told_again_where_only_a_later_request_was_heard(rig: Rig) -> None:
    """One that is for the laser alone."""
    async with rig.read() as (lidar, _):
        cut(rig.device, 0.25, "requests")
        await lidar.stop()
        assert left_still(rig), names(rig)[-6:]


@pytest.mark.long
@pytest.mark.real_time
@pytest.mark.parametrize(
    ("server", "lost", "model"),
    in_turns((PtyServer, TcpServer), (2, 4, 8), ("rplidar-s2", "rplidar-a1", "ydlidar-4ros", "hokuyo-urg04lx")),
)
async def test_one_at_a_real_line_too(server: Any, lost: int, model: str) -> None:
    """It loses so many writes of the program, and what the device sends meanwhile, however long that takes."""
    rig = make_rig(model)
    device, left = rig.device, lost
    hear, send = device.receive, device.transmit

    def receive(data: bytes, at_ns: int) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            hear(data, at_ns)

    def transmit(at_ns: int) -> bytes:
        sent: bytes = send(at_ns)
        return sent if left <= 0 else b""

    with server(device) as served:
        way = f"serial://{served.path}" if server is PtyServer else "tcp://{}:{}".format(*served.address)
        async with open_lidar(way, family=rig.family) as lidar:
            await anext(lidar.scans())
            with served.lock:
                device.receive, device.transmit = receive, transmit
        await asyncio.sleep(0.1)  # what was written last has arrived
        with served.lock:
            # A pseudo-terminal has no DTR.
            assert not device.scanning
            assert model == "rplidar-a1" or is_off(device)


@pytest.mark.parametrize("delay_s", [0.12, 0.3, 1.5])
async def test_one_that_takes_its_time_is_not_mistaken_for_one_that_heard(rplidar: Rig, delay_s: float) -> None:
    """Its response comes when it was told to stop again already, and that it has discarded."""
    async with rplidar.read():
        rplidar.device.response_delay_s = delay_s
        cut(rplidar.device, 0.06)


async def test_closing_that_is_cancelled_or_done_twice_goes_on_all_the_same(rig: Rig) -> None:
    lidar = await rig.open()
    await anext(lidar.scans())
    cut(rig.device, 0.5)
    closing = [asyncio.ensure_future(lidar.close()) for _ in range(2)]
    for _ in range(3):
        await asyncio.sleep(0.1)
        closing[0].cancel()
    await asyncio.wait(closing)
    assert closing[0].cancelled()
    assert not lidar.is_connected


async def test_it_is_told_where_nothing_comes_any_more(caplog: pytest.LogCaptureFixture) -> None:
    """By both, and the second one does not wait as long again."""
    rig = make_rig("rplidar")
    async with rig.read() as (lidar, _):
        cut(rig.device, 60.0)
        with takes(2.3, more_than_s=2.0), pytest.raises(StreamFailed, match="it does not respond any more"):
            await lidar.stop()
        caplog.clear()
        with takes(0.3):
            await lidar.close()
    assert [message.partition(":")[0] for message in caplog.messages] == ["the device was not seen to stop"]
    assert rig.device.scanning


async def test_it_is_asked_only_what_it_has_responded_to_before(rplidar: Rig) -> None:
    tell = rplidar.device.identity.respond
    rplidar.device.identity.respond = lambda asked, *of: None if asked.name == "get_health" else tell(asked, *of)
    async with rplidar.read() as (lidar, _):
        asked = len(names(rplidar))
        with takes(0.2):
            await lidar.close()
    assert "get_health" not in names(rplidar)[asked:]
    assert "get_info" in names(rplidar)[asked:]
