"""What a simulated device keeps is bounded, whatever its client does: rows of ``docs/bounds.md``."""

from __future__ import annotations

import pytest

from lidario import simulate
from lidario.families.rplidar.simulated.requests import RequestReader
from lidario.sim.faults import parse_faults

SECOND = 1_000_000_000
AT_ONCE = 20_000
"""Requests."""


@pytest.mark.long
@pytest.mark.discards("a device that is asked without end responds to some of it")
@pytest.mark.parametrize(
    ("model", "request_", "most"), [("rplidar-s2", b"\xa5\x50", 27), ("ydlidar-4ros", b"\xa5\x90", 51_200 + 27)]
)
def test_responses_to_a_flood_of_requests_do_not_pile_up(model: str, request_: bytes, most: int) -> None:
    device = simulate(model, spin_up=0)
    device.transmit(SECOND)
    device.receive(request_ * AT_ONCE, SECOND)
    assert 0 < len(device.transmit(100 * SECOND)) <= most
    assert len(device.log) <= 4096


def test_a_request_that_never_ends_is_kept_no_longer_than_its_length_says() -> None:
    reader = RequestReader()
    ended = [byte for byte in range(2000) if reader.feed((b"\xa5\x82\xff" + bytes(2000))[byte], 0) is not None]
    assert ended == [2 + 1 + 255 + 1 - 1]
    reader.feed(0xA5, 0)
    assert reader.overdue(6 * SECOND) is not None
    assert reader.overdue(7 * SECOND) is None


@pytest.mark.parametrize(("fault", "seconds"), [("late:0.3s", 0.3), ("stall:500ms", 0.5)])
def test_a_fault_holds_bytes_back_for_its_time_and_no_longer(fault: str, seconds: float) -> None:
    faults, held, most = parse_faults(fault), 0, 0
    step = SECOND // 100
    for number in range(1000):
        held += 320 - len(faults.apply(bytes(320), number * step))
        most = max(most, held)
    assert 0 < most <= 320 * (100 * seconds + 1)
