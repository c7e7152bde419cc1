"""Devices that take their time: stopped in the midst of anything, they are still, and that was seen.

A strict device discards the stop requests as long as it owes a response. They are written again until the line
tells that they were heard. No document says how long a device may take; responses are waited for for up to 2 s.
"""

import asyncio
from contextlib import suppress
from functools import partial
from itertools import product

import pytest

from lidario import ConnectFailed, LidarError, ResponseTimeout, ScanStream, StreamFailed, open_lidar
from lidario.families.rplidar.simulated.device import SimulatedRplidar
from tests.session.test_two_tasks import (
    Scene,
    Work,
    ask_while_scanning,
    b_cancels,
    b_closes,
    b_stops,
    reset,
    set_speed,
    start,
)
from tests.support.devices import SWITCHED, Rig, both_families, is_off, leave_streaming, left_still, make_rig, names
from tests.support.loop import at_each, now_ns
from tests.support.times import takes

pytestmark = pytest.mark.discards("stop requests are tried while a response is outstanding")

SLOWEST_S = 1.5
DELAYS_S = [0.05, 0.1, 0.11, 0.13, 0.2, 0.5, SLOWEST_S]
LONGEST_CLOSE_S = 2 * SLOWEST_S + 0.3
"""A response is waited for that is owed; then the line is listened to, and the device asked whether it hears."""
A: list[Work] = [start, ask_while_scanning, set_speed, reset]
B: list[Work] = [b_stops, b_closes, b_cancels]


async def both(kind: str, delay_s: float, a: Work, b: Work, moment_s: float) -> None:
    """Task A; after a while task B; then the device must be still, before the session is closed and behind it."""
    rig = make_rig(kind)
    lidar = await rig.open()
    scene = Scene(rig, lidar)
    rig.device.response_delay_s = delay_s
    task = asyncio.ensure_future(a(scene))
    await asyncio.sleep(moment_s)
    stray = lidar.stats.stray_bytes
    if b is b_cancels:
        task.cancel()
    with suppress(StreamFailed):
        await b(scene)
    with suppress(LidarError, StopAsyncIteration, asyncio.CancelledError):
        await task
    scene.streams.clear()
    await asyncio.sleep(5.0)
    assert not lidar.is_scanning
    assert is_off(rig.device)
    assert lidar.stats.stray_bytes - stray < 200, "a stream came into an idle session"
    with takes(LONGEST_CLOSE_S):
        await lidar.close()
    await asyncio.sleep(2 * SLOWEST_S)
    assert is_off(rig.device)


@pytest.mark.long
@pytest.mark.exhaustive("phases", sample=[1], full=[4])
@pytest.mark.exhaustive("delay_s", sample=[0.13, 0.2, SLOWEST_S], full=DELAYS_S)
@pytest.mark.parametrize("b", B, ids=lambda work: work.__name__)
@both_families
def test_it_is_stopped_at_any_moment(family: str, b: Work, delay_s: float, phases: int) -> None:
    moments_s = [0.02 + 4 * delay_s * (phase + 0.3) / phases for phase in range(phases)]
    for a in A:
        at_each(moments_s, partial(both, family, delay_s, a, b), a.__name__)


@pytest.mark.exhaustive("delay_s", sample=[0.6, 0.9, 1.5, 1.9])
@pytest.mark.exhaustive("moment_s", sample=[0.12, 0.3, 0.7, 1.2])
async def test_closing_waits_for_a_response_that_nobody_wants(rig: Rig, moment_s: float, delay_s: float) -> None:
    async with rig.open() as lidar:
        await lidar.scan()
        rig.device.response_delay_s = delay_s
        asking = asyncio.ensure_future(lidar.get_health())
        await asyncio.sleep(moment_s)
    await asyncio.gather(asking, return_exceptions=True)


async def test_a_response_that_never_comes_is_waited_for_2_s_but_by_the_stop_requests_for_a_tenth(rig: Rig) -> None:
    async with rig.open() as lidar:
        asked = len(names(rig))
        rig.device.mute = True
        with takes(2.3, more_than_s=2.0):
            asking = asyncio.ensure_future(lidar.get_health())
            await asyncio.sleep(0.05)
            closing = asyncio.ensure_future(lidar.close())
            for passed_s, is_written in ((0.09, False), (0.02, True)):
                await asyncio.sleep(passed_s)
                assert ("stop" in names(rig)[asked:]) is is_written
            await closing
    await asyncio.gather(asking, return_exceptions=True)


@pytest.mark.parametrize("question", ["get_zero_offset", "get_scan_frequency"])
async def test_settings_of_a_4ros_are_waited_for_as_long_as_the_vendor_does(ydlidar: Rig, question: str) -> None:
    async with ydlidar.open() as lidar:
        told, asked = list[float](), list[list[str]]()
        await lidar.stop()
        for ydlidar.device.response_delay_s in (0.0, 1.9):
            before = len(names(ydlidar))
            told.append(await getattr(lidar, question)())
            asked.append([each for each in names(ydlidar)[before:] if "stop" not in each])
        # The first attempt is enough: nothing was asked once more.
        assert told[0] == told[1]
        assert asked[0] == asked[1]
        ydlidar.device.mute = True
        with takes(4.2, more_than_s=3.8), pytest.raises(ResponseTimeout):
            await getattr(lidar, question)()


async def test_a_response_that_has_come_too_late_is_owed_no_longer(rig: Rig) -> None:
    async with rig.open() as lidar:
        await lidar.scan()
        rig.device.response_delay_s = 1.0
        with pytest.raises(ResponseTimeout):
            await lidar.get_health()
        rig.device.response_delay_s = 0.0
        await asyncio.sleep(0.2)
        # One that may still come is waited for until 2 s after its request.
        with takes(0.5):
            await lidar.stop()
        assert left_still(rig)


@pytest.mark.parametrize("model", SWITCHED)
def test_motors_of_other_kinds(model: str) -> None:
    """By DTR, and by an accessory board."""
    for a, b in product((start, ask_while_scanning, reset), B):
        at_each((0.05, 0.5, 1.2), partial(both, model, 0.2, a, b), f"{a.__name__} x {b.__name__}")


@pytest.mark.parametrize(("model", "stop"), [("rplidar", b"\xa5\x25"), ("hokuyo", b"QT\n")])
async def test_it_is_logged_where_it_is_not_seen(model: str, stop: bytes, caplog: pytest.LogCaptureFixture) -> None:
    """A device that hears nothing any more and streams on."""
    rig, heard = make_rig(model), list[bytes]()
    async with rig.read() as (lidar, _):
        rig.device.receive = lambda data, now: heard.append(data)
        with (
            takes(2.3, more_than_s=2.0),
            pytest.raises(StreamFailed, match="bytes still arrive after several stop requests"),
        ):
            await lidar.stop()
        assert b"".join(heard).count(stop) >= 10
        caplog.clear()
    (message,) = caplog.messages
    assert message.startswith("the device was not seen to stop: bytes still arrive after several stop requests")
    assert rig.device.scanning


@pytest.mark.parametrize("rig", ["rplidar-a1", "rplidar-a2", "rplidar-s2"], indirect=True)
@pytest.mark.parametrize("ways", ["unknown type", "always another"])
@pytest.mark.parametrize("family", ["rplidar", None])
async def test_a_device_that_nobody_understands_is_left_still(rig: Rig, ways: str, family: str | None) -> None:
    """Its motor is driven by DTR, by an accessory board, by its own request; it was on before."""
    leave_streaming(rig.device, now_ns())
    garble(rig.device, ways)
    with pytest.raises(LidarError):
        await open_lidar(rig.device, family=family)
    assert is_off(rig.device)


def garble(device: SimulatedRplidar, ways: str) -> None:
    respond, count = device.respond, 0

    def odd(kind: int, data: bytes, request: object) -> str:
        nonlocal count
        count += 1
        if ways == "unknown type":
            return respond(0x77, data, request)  # type: ignore[arg-type]
        return respond(kind, bytes([data[0]]) + count.to_bytes(len(data) - 1, "little"), request)  # type: ignore[arg-type]

    device.respond = odd  # type: ignore[method-assign]


async def test_the_stop_requests_go_on_though_the_task_that_closes_is_cancelled_twice(rplidar: Rig) -> None:
    lidar = await rplidar.open()
    rplidar.device.response_delay_s = 0.5
    reading = asyncio.ensure_future(ScanStream.__anext__(lidar.scans()))
    await asyncio.sleep(2.3)
    closing = asyncio.ensure_future(lidar.close())
    for _ in range(2):
        await asyncio.sleep(0.01)
        closing.cancel()
    await asyncio.wait([closing, reading])
    assert closing.cancelled()
    reading.exception()


async def test_a_silent_port_is_not_waited_for(rplidar: Rig) -> None:
    """Nothing has ever responded: there is no device that takes its time."""
    rplidar.device.mute = True
    opening = asyncio.ensure_future(rplidar.open().__aenter__())
    await asyncio.sleep(2.0)
    opening.cancel()
    with takes(1.0), pytest.raises((asyncio.CancelledError, ConnectFailed)):
        await opening


@pytest.mark.parametrize("delay_s", [0.05, 0.1, 0.15, 0.2, 0.3])
async def test_responses_to_stop_requests_are_no_stream(delay_s: float, caplog: pytest.LogCaptureFixture) -> None:
    """A Hokuyo responds to them, too."""
    rig = make_rig("hokuyo")
    async with rig.open() as lidar:
        rig.device.response_delay_s = delay_s
        await lidar.scan()
        await lidar.stop()
        assert left_still(rig)
    assert caplog.messages == []
    assert names(rig).count("stop") < 8


@pytest.mark.parametrize("delay_s", [0.9, 1.5])
@pytest.mark.parametrize("moment_s", [0.1, 0.3, 0.56])
async def test_one_that_has_not_responded_yet_but_streamed_is_waited_for(delay_s: float, moment_s: float) -> None:
    """It owes a response when its opening is cancelled, and discards what stops its motor until that has come."""
    rig = make_rig("rplidar-a2")
    rig.device.response_delay_s = delay_s
    leave_streaming(rig.device, now_ns())
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(moment_s):
            await rig.open()
    assert left_still(rig)
