"""Serial ports that the event loop cannot wait for: on Windows the same thread reads, by pyserial's own calls.

These tests take that way on Linux. What does not depend on the system is real: pyserial on a pseudo-terminal, the
part of pyserial-asyncio that is meant for Windows, and an event loop that refuses to wait for a terminal.
`test_serial` has what holds on each system alike.
"""

import asyncio
import os
import select
import time

import pytest

from lidario.session.opening import open_lidar
from lidario.sim.serve import PtyServer
from tests.port.test_thread import Steady, block_until_read, threads
from tests.support.devices import both_families, left_still, make_rig
from tests.support.ports import PATIENCE_S, opened_terminal, written

pytestmark = pytest.mark.usefixtures("windows")
REQUEST = b"\xa5\x60"


async def test_a_blocked_loop_loses_nothing() -> None:
    """Five times what the terminal holds comes while the loop stands still."""
    async with opened_terminal(1_000_000) as (port, sink, master):
        port.set_polling(Steady())
        assert len(threads()) == 1
        os.set_blocking(master, False)
        sent, deadline = bytes(range(250)) * 400, time.monotonic() + PATIENCE_S
        at = 0
        while at < len(sent):
            assert time.monotonic() < deadline, f"the line is full after {at} bytes"
            # Nothing of this program reads but the thread.
            if select.select([], [master], [], 1.0)[1]:
                at += os.write(master, sent[at : at + 1000])
        block_until_read(len(sent))
        port.poll()
        assert bytes(sink.data) == sent
    assert threads() == []


async def test_the_thread_repeats_a_request_while_the_loop_is_blocked() -> None:
    async with opened_terminal(1_000_000) as (port, _, master):
        port.set_polling(Steady())
        port.set_repeat(REQUEST, 0.02)
        assert written(master, len(REQUEST)) == REQUEST
        port.set_repeat(b"")
        assert port.repeated >= 1


@pytest.mark.long
@both_families
async def test_a_session_reads_scans_and_stops_the_device(family: str) -> None:
    rig = make_rig(family)
    with PtyServer(rig.device, chunk=64) as server:
        async with asyncio.timeout(PATIENCE_S), open_lidar(server.path, family=family) as lidar:
            scans = lidar.scans(depth=100)
            first = await anext(scans)
            assert threads()
            time.sleep(0.3)  # noqa: ASYNC251 - a program that blocks its loop
            last = first
            while last.seq < first.seq + 4:
                last = await anext(scans)
            stats = lidar.stats
    # On a busy machine the thread may come too late for what the terminal holds.
    if not server.lost:
        assert (stats.skipped_bytes, stats.lost_packets, stats.broken_scans) == (0, 0, 0)
    assert left_still(rig)
    assert not threads()
