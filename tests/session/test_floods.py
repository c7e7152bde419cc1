"""A device that sends as fast as it can holds nobody up: each turn of the loop does a bounded part of the work.

On a driven clock, on which each step of the work takes a millisecond. ``python -m benchmarks.floods`` measures the
same with real peers.
"""

import asyncio
import tracemalloc
from collections.abc import Iterator
from typing import Any

import pytest

from benchmarks.floods.bytes import blob
from lidario import DeviceLost
from lidario.port.turns import MOST_WAITING, TURN_NS
from lidario.revolution.assemble import Assembler
from lidario.scans.scan import Scan
from lidario.session.talking.intake import IDLE_SLICE
from lidario.wire.link import Link
from tests.support.devices import Rig, make_rig, scanning
from tests.support.loop import DrivenLoop, driven_loop

STEP_S = 0.001
MOST_STEPS = round(TURN_NS * 1e-9 / STEP_S) + 1
FLOODS = ("short", "restarts", "heads", "endless")


class Steps:
    """Counts the steps of each turn of the loop, and has each take its time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, loop: DrivenLoop) -> None:
        self.each_turn: list[int] = []
        self.all = self._before = 0
        self._loop = loop
        self.takes_time = False
        receive, ends = Link.receive_data, Assembler.ends

        def received(link: Link, *values: Any) -> None:
            self._step()
            receive(link, *values)

        def ended(assembler: Assembler, *values: Any) -> Iterator[list[Scan]]:
            for scans in ends(assembler, *values):
                self._step()
                yield scans

        monkeypatch.setattr(Link, "receive_data", received)
        monkeypatch.setattr(Assembler, "ends", ended)
        loop.at_turn = self._turn

    async def flooded(self, rig: Rig) -> None:
        """The steps take their time for a while, in which others run, too; then the device falls silent."""
        self.takes_time = True
        for _ in range(15):
            await asyncio.sleep(STEP_S)
        self.takes_time = False
        rig.device.transmit = lambda _: b""

    def _step(self) -> None:
        if self.takes_time:
            self.all += 1
            self._loop.block(STEP_S)

    def _turn(self, _: int) -> None:
        self.each_turn.append(self.all - self._before)
        self._before = self.all


def flood(rig: Rig, kind: str, size: int) -> None:
    """From now on the device sends so many bytes every ten milliseconds, whatever it is told."""
    data = blob(kind, size)
    rig.device.transmit = lambda _: data
    rig.device.wakeup = lambda now: now + 10_000_000


@pytest.mark.long
@pytest.mark.parametrize("kind", FLOODS)
async def test_each_turn_of_the_loop_does_a_bounded_part(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    loop = driven_loop()
    steps, rig = Steps(monkeypatch, loop), make_rig("rplidar")
    async with rig.read():
        flood(rig, kind, 256 * 1024)
        await steps.flooded(rig)
    assert steps.all > 40
    assert MOST_STEPS - 1 <= max(steps.each_turn) <= MOST_STEPS


@pytest.mark.long
async def test_what_is_too_much_is_dropped_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = driven_loop()
    steps, rig = Steps(monkeypatch, loop), make_rig("rplidar")
    async with rig.open() as lidar:
        async with scanning(lidar):
            before = lidar.stats
            flood(rig, "short", 256 * 1024)
            tracemalloc.start()
            try:
                await steps.flooded(rig)
                assert tracemalloc.get_traced_memory()[1] < 8 * MOST_WAITING
            finally:
                tracemalloc.stop()
            after = lidar.stats
        dropped = after.discarded_bytes - before.discarded_bytes
        assert dropped > MOST_WAITING
        # Of the rest, so much was parsed.
        assert after.bytes_received - before.bytes_received - dropped <= steps.all * IDLE_SLICE


async def test_what_came_before_the_line_was_lost_is_decoded_first(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = driven_loop()
    steps, rig = Steps(monkeypatch, loop), make_rig("rplidar")
    async with rig.open() as lidar, scanning(lidar, depth=100) as stream:
        # A program that blocks its loop for three seconds, while the device sends and is then unplugged.
        steps.takes_time = True
        turns = len(steps.each_turn) + 1
        rig.device.unplugged = lambda _: len(steps.each_turn) > turns
        loop.block(3.0)
        scans = []
        with pytest.raises(DeviceLost):
            while True:
                scans.append(await anext(stream))
    assert len(scans) > 25
    assert max(steps.each_turn) <= MOST_STEPS
