"""Packets that come before anybody can read them belong to the stream that brought them, and to no later one."""

from __future__ import annotations

import asyncio

from tests.support.devices import Rig
from tests.support.loop import driven_loop, now_ns

BLOCKED_S = 0.05
"""For so long the program blocks its loop: then the descriptor and many packets are read at once."""


async def test_a_stream_that_was_stopped_as_it_began_leaves_no_packets_to_the_next(rig: Rig) -> None:
    loop = driven_loop()
    async with rig.open() as lidar:
        await lidar.get_modes()
        reading = asyncio.ensure_future(anext(lidar.scans()))
        while "scan" not in rig.device.log[-1].name:
            await asyncio.sleep(0.0001)
        loop.block(BLOCKED_S)
        await asyncio.sleep(0)  # so that `stop` and what was received come in one step, before the start can end
        await lidar.stop()
        await asyncio.wait([reading])
        assert isinstance(reading.exception(), StopAsyncIteration)
        assert lidar.stats.discarded_packets > 1, "no packet came before the stop requests"
        await lidar.scan()
        stats = lidar.stats
        assert stats.lost_packets == stats.broken_scans == stats.missed_scans == 0, stats


async def test_what_was_read_together_with_the_descriptor_is_delivered(rig: Rig) -> None:
    """Three revolutions and more, too many bytes to be parsed in one step."""
    loop = driven_loop()
    async with rig.open() as lidar:
        await lidar.get_modes()
        async with lidar.scans(depth=16) as stream:
            reading = asyncio.ensure_future(anext(stream))
            while "scan" not in rig.device.log[-1].name:
                await asyncio.sleep(0.0001)
            loop.block(0.6)
            read_ns = now_ns()
            first = await reading
            assert first.stamp_ns < read_ns - 300_000_000
            assert [(await anext(stream)).seq for _ in range(3)] == [1, 2, 3]
            assert lidar.stats.lost_packets == 0
