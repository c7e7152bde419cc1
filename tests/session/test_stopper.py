"""When the stop requests are written, on every event loop; uvloop counts whole milliseconds."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable, Sequence

import pytest

from lidario.families.registry import FAMILIES
from lidario.session.stopper import Stopper
from lidario.wire.envelope import Request

LOOPS: list[Callable[[], asyncio.AbstractEventLoop]] = [asyncio.new_event_loop]
if sys.platform != "win32":
    import uvloop

    LOOPS.append(uvloop.new_event_loop)


class Paper:
    """Notes the requests that it is to write, and listens a little later than now."""

    def __init__(self, listens_in: float) -> None:
        self.is_open = True
        self.bytes_received = 0
        self.written: list[Request] = []
        self._listens_at = asyncio.get_running_loop().time() + listens_in

    def free_at(self, patient_until: float) -> float:
        return self._listens_at

    def write(self, requests: Sequence[Request]) -> None:
        self.written += requests

    def close_port(self) -> None:
        self.is_open = False


@pytest.mark.parametrize("make_loop", LOOPS)
@pytest.mark.parametrize("listens_in", [1e-5, 3e-4, 2e-3])
def test_the_device_listens_in_less_than_a_tick_of_the_clock(
    listens_in: float, make_loop: Callable[[], asyncio.AbstractEventLoop]
) -> None:
    async def main() -> None:
        for _ in range(20):
            paper = Paper(listens_in)
            stopper = Stopper(paper, FAMILIES[0].device(), 0.0)
            stopper.stop()
            began = time.monotonic()
            await stopper.surely_written()
            assert stopper.still
            assert len(paper.written) == len(stopper.requests())
            assert time.monotonic() - began < 5.0

    with asyncio.Runner(loop_factory=make_loop) as runner:
        runner.run(main())
