"""When the stop requests are written, and how often.

The device listens at any time, on every event loop: uvloop counts whole milliseconds.
"""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from lidario.families.registry import FAMILIES
from lidario.families.rplidar import commands as rplidar
from lidario.families.rplidar.nodes import NodeFormat
from lidario.session.talking.stopper import Stopper
from lidario.wire.envelope import Request
from tests.support.loop import driven, now

LOOPS: list[Callable[[], asyncio.AbstractEventLoop]] = [asyncio.new_event_loop]
if sys.platform != "win32":
    import uvloop

    LOOPS.append(uvloop.new_event_loop)


UNKNOWN = len(FAMILIES[0].device().halt_unknown())
"""Requests that are written at the end to a device that has not said what it is."""


class Paper:
    """Notes the requests that it is to write, and listens a little later than now."""

    def __init__(self, listens_in: float) -> None:
        self.port: Any = self
        self.stats: Any = self
        self.is_open = True
        self.bytes_received = 0
        self.owes_until = 0.0
        self.told: list[bool] = []
        self.written: list[Request] = []
        self._listens_at = now() + listens_in

    def free_at(self, patient_until: float) -> float:
        return self._listens_at

    def write(self, requests: Sequence[Request]) -> None:
        self.written += requests

    def forget(self) -> None:
        self.owes_until = 0.0

    def settled(self, still: bool) -> None:
        self.told.append(still)

    def close_soon(self) -> None:
        self.is_open = False


def stopper_of(paper: Paper, quiet_s: float) -> Stopper:
    readiness: Any = paper
    return Stopper(paper, readiness, FAMILIES[0].device(), quiet_s)


@driven
async def test_what_may_set_the_device_in_motion() -> None:
    """As long as nothing was sent that may, the stop requests are not written again."""
    stopper = stopper_of(Paper(0.0), 0.0)
    for request, before, after in (
        (rplidar.GET_INFO, True, True),
        (rplidar.GET_INFO, False, False),
        (rplidar.scan(NodeFormat()), True, False),
        (rplidar.motor_speed(600), True, False),
        # STOP leaves the motor as it is.
        (rplidar.STOP, True, True),
        (rplidar.STOP, False, False),
        # Not every motor stops with it, and a device that is busy does not hear it.
        (rplidar.RESET, True, True),
        (rplidar.RESET, False, False),
    ):
        stopper.still = before
        stopper.sent(request)
        assert stopper.still is after, request.name


@driven
async def test_they_are_written_once_until_something_moves() -> None:
    paper = Paper(0.0)
    stopper = stopper_of(paper, 0.0)
    stopper.stop()
    stopper.stop()
    assert paper.written == [replace(request, ends_stream=True) for request in stopper.requests()]
    assert not paper.told
    await stopper.surely_settled()
    assert paper.told == [True]
    stopper.stop()
    assert len(paper.written) == len(stopper.requests())
    stopper.sent(rplidar.motor_speed(600))
    stopper.stop()
    assert len(paper.written) == 2 * len(stopper.requests())
    await stopper.surely_settled()
    assert paper.told == [True, True]


@driven
async def test_only_who_hangs_up_leaves_the_port_to_timers() -> None:
    paper = Paper(0.0)
    stopper = stopper_of(paper, 0.0)
    assert not stopper.ends_by_itself
    stopper.stop()
    assert stopper.ends_by_itself is False
    await stopper.surely_settled()
    # Now it is still.
    states = [stopper.ends_by_itself]
    stopper.sent(rplidar.motor_speed(600))
    stopper.hang_up()
    states.append(stopper.ends_by_itself)
    stopper.cancel()
    states.append(stopper.ends_by_itself)
    stopper.still = True
    states.append(stopper.ends_by_itself)
    assert states == [False, True, False, True]


@pytest.mark.parametrize("comes", [True, False])
@driven
async def test_a_device_that_owes_a_response_is_told_again_when_it_has_come(comes: bool) -> None:
    """Also where it never comes; what is quiet meanwhile proves nothing."""
    paper = Paper(0.0)
    paper.owes_until = now() + 1.5
    stopper = stopper_of(paper, 0.02)
    stopper.stop()
    count = len(stopper.requests())
    await asyncio.sleep(0.7)
    assert len(paper.written) == count
    assert not paper.told
    if comes:
        paper.owes_until = 0.0
        stopper.try_now()
        assert len(paper.written) == 2 * count
    await stopper.surely_settled()
    assert now() == pytest.approx(1000.72 if comes else 1001.52, abs=0.01)
    assert len(paper.written) == 2 * count
    assert paper.told == [True]


@driven
async def test_a_line_that_is_left_is_not_waited_for() -> None:
    """Also where the stop requests were written before, and a response is owed."""
    paper = Paper(0.0)
    paper.owes_until = now() + 1.5
    stopper = stopper_of(paper, 0.02)
    stopper.stop()
    await asyncio.sleep(0.1)
    stopper.hang_up(patient=False)
    await stopper.surely_settled()
    assert not paper.is_open
    assert now() < 1000.2


@driven
async def test_a_device_that_goes_on_sending_is_told_three_times(caplog: pytest.LogCaptureFixture) -> None:
    paper = Paper(0.0)
    stopper = stopper_of(paper, 0.02)

    async def send() -> None:
        while paper.is_open:
            paper.bytes_received += 1
            await asyncio.sleep(0.001)

    sending = asyncio.ensure_future(send())
    stopper.hang_up()
    assert paper.is_open
    async with asyncio.timeout(5.0):
        await sending
    assert paper.told == [False]
    assert len(paper.written) == 3 * len(stopper.requests()) + UNKNOWN
    assert [record.getMessage() for record in caplog.records] == [
        "the device goes on sending after 3 stop requests"
    ]


@driven
async def test_the_port_is_closed_when_the_line_is_quiet(caplog: pytest.LogCaptureFixture) -> None:
    loop = asyncio.get_running_loop()
    paper = Paper(0.0)
    stopper = stopper_of(paper, 0.02)
    # The rest of the packet that was being sent.
    loop.call_later(0.005, setattr, paper, "bytes_received", 40)
    began = loop.time()
    stopper.hang_up()
    async with asyncio.timeout(5.0):
        while paper.is_open:
            await asyncio.sleep(0.001)
    assert loop.time() - began == pytest.approx(0.04, abs=0.003)
    assert len(paper.written) == 2 * len(stopper.requests()) + UNKNOWN
    assert not caplog.records


@pytest.mark.parametrize("make_loop", LOOPS)
@pytest.mark.parametrize("listens_in", [1e-5, 3e-4, 2e-3])
def test_the_device_listens_in_less_than_a_tick_of_the_clock(
    listens_in: float, make_loop: Callable[[], asyncio.AbstractEventLoop]
) -> None:
    async def main() -> None:
        for _ in range(20):
            paper = Paper(listens_in)
            stopper = stopper_of(paper, 0.0)
            stopper.stop()
            began = time.monotonic()
            await stopper.surely_settled()
            assert stopper.still
            assert len(paper.written) == len(stopper.requests())
            assert time.monotonic() - began < 5.0

    with asyncio.Runner(loop_factory=make_loop) as runner:
        runner.run(main())
