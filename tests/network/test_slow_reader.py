"""A reader of a fleet that is slower than its lidars gets what is new, and each lidar has its turn."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest

from lidario.errors import Busy
from lidario.network import handover
from lidario.network.bus import Bus
from lidario.network.keys import Attachment
from lidario.network.messages import encode_scan
from lidario.ros import Fleet, FleetScan
from tests.network.test_bus import Bytes, Session
from tests.scans.test_scan import FOUR

LIDARS = 32
TURN_MS = 100
WORK_MS = 13
"""What the reader needs for one scan, without an await: 416 ms for a round, in which each lidar sends four."""
MESSAGE = encode_scan(FOUR)


class Came:
    """A scan as zenoh gives it."""

    kind = "PUT"

    def __init__(self, lidar: int, number: int, at_ms: int) -> None:
        self.key_expr = f"robots/{lidar}/scan"
        self.payload = Bytes(MESSAGE)
        self.attachment = Bytes(Attachment(number, at_ms * 10**6, lidar.to_bytes(16, "little")).to_bytes())


class Network:
    """Lidars that publish at 10 Hz, each at its own moment, on a clock of their own."""

    def __init__(self, receive: Callable[[Any], None]) -> None:
        self.now_ms = 0
        self._receive = receive
        self._numbers = Counter[int]()

    def pass_time(self, milliseconds: int) -> None:
        """What comes meanwhile is handed over in zenoh's thread, whatever the event loop does."""
        for _ in range(milliseconds):
            self.now_ms += 1
            for lidar in range(LIDARS):
                if (self.now_ms + 3 * lidar) % TURN_MS == 0:
                    self._numbers[lidar] += 1
                    self._receive(Came(lidar, self._numbers[lidar], self.now_ms))


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Session:
    """The session of zenoh that each bus has."""
    made = Session()

    async def opened(router: str) -> Bus:
        return Bus(made, router)

    monkeypatch.setattr(Bus, "open", opened)
    monkeypatch.setattr(Bus, "close", lambda _: asyncio.sleep(0))
    # The reader's time is driven; how fast this machine is at parsing must not end a turn of the loop.
    monkeypatch.setattr(handover, "TURN_NS", 10**12)
    return made


@pytest.mark.long
async def test_a_slow_reader_gets_no_old_scans(session: Session) -> None:
    found = list[tuple[int, FleetScan]]()  # each with its age in milliseconds
    async with Fleet("robots/*/scan") as fleet:
        network = Network(session.receive)
        network.pass_time(2000)
        while len(found) < 20 * LIDARS:
            each = await anext(fleet)
            found.append((network.now_ms - each.sent_ns // 10**6, each))
            network.pass_time(WORK_MS)
    # Each lidar has its turn, and what it gives is of the last revolution. Much had come before the first round.
    assert max(age for age, _ in found[LIDARS:]) <= TURN_MS
    assert set(Counter(each.key for _, each in found).values()) == {20}
    assert fleet.lost == 0
    assert fleet.dropped > 50 * LIDARS
    # What is missing is told by the next scan of the lidar.
    last = found[-LIDARS * 2 :]
    assert sum(1 + each.lost for _, each in last) == pytest.approx(2 * LIDARS * LIDARS * WORK_MS / TURN_MS, rel=0.1)


async def test_two_tasks_that_read_one_fleet_are_told(session: Session) -> None:
    async with Fleet("robots/*/scan") as fleet:
        Network(session.receive).pass_time(TURN_MS)
        results = await asyncio.gather(anext(fleet), anext(fleet), return_exceptions=True)
        assert [type(each) for each in results] == [FleetScan, Busy]
        # Cancelling loses none.
        reading = asyncio.ensure_future(anext(fleet))
        await asyncio.sleep(0)
        reading.cancel()
        await asyncio.wait([reading])
        await fleet.close()
        assert len([each async for each in fleet]) == LIDARS - 1
