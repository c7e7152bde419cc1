"""What a program that blocked its event loop finds: seconds of a stream at once, late and whole.

Packets that come before anybody can read them belong to the stream that brought them, and to no later one.
"""

import asyncio
from itertools import pairwise

import pytest

from lidario import Lidar, Scan, ScanStream
from tests.support.devices import Rig, some
from tests.support.loop import driven_loop, now_ns


@pytest.mark.parametrize("block_s", [0.2, 0.8, 3.0])
async def test_revolutions_that_come_late_and_whole_are_delivered(rig: Rig, block_s: float) -> None:
    loop = driven_loop()
    async with rig.open() as lidar, lidar.scans(depth=100) as stream:
        scans = await some(stream, 2)
        for _ in range(3):
            loop.block(block_s)
            unblocked = loop.time()
            while scans[-1].stamp_ns * 1e-9 < unblocked:
                scans.append(await anext(stream))
        stats = lidar.stats
    assert (stats.broken_scans, stats.lost_packets, stats.dropped_scans) == (0, 0, 0)
    assert len(scans) >= 3 * block_s / rig.turn_s
    # The packets that came in time tell the time of those that came late.
    for one, other in pairwise(scans):
        assert (other.stamp_ns - one.stamp_ns) * 1e-9 == pytest.approx(rig.turn_s, rel=0.1)


async def blocked_as_it_begins(rig: Rig, lidar: Lidar, stream: ScanStream, seconds: float) -> asyncio.Future[Scan]:
    """Begin to read; the program blocks its loop as soon as the device has heard that it is to scan."""
    await lidar.get_modes()
    reading = asyncio.ensure_future(anext(stream))
    while "scan" not in rig.device.log[-1].name:
        await asyncio.sleep(0.0001)
    driven_loop().block(seconds)
    return reading


@pytest.mark.parametrize("received", [False, True])
@pytest.mark.parametrize("block_s", [0.05, 0.6])
async def test_a_stream_stopped_as_it_began_leaves_nothing(rig: Rig, block_s: float, received: bool) -> None:
    """Descriptor and packets, also of whole revolutions, are read at once behind the stop, or just before it."""
    async with rig.open() as lidar:
        reading = await blocked_as_it_begins(rig, lidar, lidar.scans(), block_s)
        for _ in range(1 + received):
            await asyncio.sleep(0)  # so that `stop` and what was received come before the start can end
        await lidar.stop()
        await asyncio.wait([reading])
        assert isinstance(reading.exception(), StopAsyncIteration)
        assert lidar.stats.discarded_packets > 1, "no packet came before the stop requests"
        stopped_ns = now_ns()
        assert (await lidar.scan()).stamp_ns > stopped_ns
        stats = lidar.stats
        assert stats.lost_packets == stats.broken_scans == stats.missed_scans == 0, stats


async def test_what_was_read_together_with_the_descriptor_is_delivered(rig: Rig) -> None:
    """Three revolutions and more, too many bytes to be parsed in one step."""
    async with rig.open() as lidar, lidar.scans(depth=16) as stream:
        reading = await blocked_as_it_begins(rig, lidar, stream, 0.6)
        read_ns = now_ns()
        first = await reading
        assert first.stamp_ns < read_ns - 300_000_000
        assert [(await anext(stream)).seq for _ in range(3)] == [1, 2, 3]
        assert lidar.stats.lost_packets == 0
