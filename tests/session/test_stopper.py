"""The stop requests where the device listens at any time, on every event loop: uvloop counts whole milliseconds.

What they do otherwise is in `test_slow_responses` and `test_stopping`.
"""

import asyncio
from collections.abc import Sequence
from typing import Any

import pytest

from lidario.families.registry import FAMILIES
from lidario.families.rplidar.commands import motor_speed
from lidario.session.talking.stopper import Stopper
from lidario.wire.envelope import Request
from tests.support.loop import now
from tests.support.ports import PATIENCE_S, on_both_loops
from tests.support.times import takes


class Paper:
    """Notes the requests that it is to write, and listens a little later than now."""

    def __init__(self, listens_in: float) -> None:
        self.port: Any = self
        self.stats: Any = self
        self.is_open = True
        self.bytes_received = self.stray_bytes = self.drained_bytes = 0
        self.chronicle: Any = self
        self.responses: dict[bytes, bytes] = {}
        self.reset_at = None
        self.owes_until = self.took_s = 0.0
        self.has_responded = False
        self.written: list[Request] = []
        self.told: list[bool] = []
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


def stopper_of(paper: Any, quiet_s: float) -> Stopper:
    return Stopper(paper, paper, FAMILIES[0].device(), quiet_s)


async def test_a_line_that_is_left_is_not_waited_for() -> None:
    """Also where the stop requests were written before, and a response is owed."""
    paper = Paper(0.0)
    paper.owes_until = now() + 1.5
    stopper = stopper_of(paper, 0.02)
    stopper.stop()
    await asyncio.sleep(0.1)
    with takes(0.1):
        stopper.hang_up(patient=False)
        await stopper.surely_settled()
    assert not paper.is_open


async def test_a_response_that_was_owed_is_taken_to_be_among_much_that_comes() -> None:
    """They are written again, and not waited for as long as it could still come."""
    paper = Paper(0.0)
    paper.owes_until = now() + 1.5
    stopper = stopper_of(paper, 0.02)
    with takes(0.2):
        stopper.stop()
        await asyncio.sleep(0.01)
        paper.bytes_received = 1000
        await stopper.surely_settled()
    assert stopper.still
    assert len(paper.written) > len(stopper.requests())


async def test_a_line_that_is_lost_is_given_up_at_once() -> None:
    """And nobody is told later that the device is still."""
    paper = Paper(0.0)
    stopper = stopper_of(paper, 0.001)
    stopper.stop()
    paper.is_open = False
    stopper.hang_up()
    await asyncio.sleep(0.05)
    assert paper.told == [False]


async def test_who_waits_for_stop_requests_goes_on_where_the_line_is_lost_meanwhile() -> None:
    paper = Paper(0.05)
    stopper = stopper_of(paper, 0.0)
    stopper.stop()
    waiting = asyncio.ensure_future(stopper.surely_settled())
    await asyncio.sleep(0)
    paper.is_open = False
    stopper.cancel()
    done, _ = await asyncio.wait([waiting], timeout=PATIENCE_S)
    stopper.wanted = False
    assert done


async def test_only_who_hangs_up_leaves_the_port_to_timers() -> None:
    stopper = stopper_of(Paper(0.0), 0.0)
    states = [stopper.ends_by_itself]
    stopper.stop()
    states.append(stopper.ends_by_itself)
    await stopper.surely_settled()
    # Now it is still.
    states.append(stopper.ends_by_itself)
    stopper.sent(motor_speed(600))
    stopper.hang_up()
    states.append(stopper.ends_by_itself)
    stopper.cancel()
    states.append(stopper.ends_by_itself)
    stopper.still = True
    assert [*states, stopper.ends_by_itself] == [False, False, False, True, False, True]


@on_both_loops
@pytest.mark.parametrize("listens_in", [1e-5, 3e-4, 2e-3])
async def test_the_device_listens_in_less_than_a_tick_of_the_clock(listens_in: float) -> None:
    for _ in range(20):
        paper = Paper(listens_in)
        stopper = stopper_of(paper, 0.0)
        stopper.stop()
        async with asyncio.timeout(PATIENCE_S):
            await stopper.surely_settled()
        assert stopper.still
        assert len(paper.written) == 2 * len(stopper.requests())


@pytest.mark.parametrize("has_responded", [False, True])
async def test_dtr_is_not_set_for_one_that_is_only_looked_for_until_it_responds(*, has_responded: bool) -> None:
    """Neither by a guard: what stops its motor starts that of a model of another family."""
    paper: Any = Paper(0.0)
    paper.has_responded = has_responded
    device = FAMILIES[0].device()
    device.is_guess = True
    stopper = Stopper(paper, paper, device, 0.0)
    _, last, _ = stopper.unseen()
    stopper.hang_up()
    await stopper.surely_settled()
    for requests in (last, paper.written):
        assert any(request.dtr for request in requests) is has_responded
