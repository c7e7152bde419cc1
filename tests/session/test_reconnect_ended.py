"""A program may end at any moment of coming back: no task goes on, and a device that was reached is still.

As in `test_loop_closed`, nothing waits after the end: what a timer would do later is not done any more.
"""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from lidario import Lidar, open_lidar
from tests.session.test_loop_closed import Interrupt, cancel_again_and_again, interrupt, never, run_and_close
from tests.support.cable import Cable, cable_to
from tests.support.devices import Rig, both_families, make_rig

OUT_S = 0.3


class ComingBack(Rig):
    """A rig whose sessions come back."""

    def open(self, **options: Any) -> Any:
        return open_lidar(self.device, family=self.family, reconnect=True, **options)


def ended_at(family: str, at: int, what: Interrupt, monkeypatch: pytest.MonkeyPatch) -> tuple[int, int, Rig, Cable]:
    """End a program in that turn of the loop; the turn in which its device was unplugged, and the last one."""
    made = make_rig(family)
    rig = ComingBack(made.family, made.device, made.turn_s)
    rig.device.boot_s = 0.3
    pulled = 0

    with cable_to(rig) as cable:

        async def work(lidar: Lidar) -> None:
            nonlocal pulled
            loop: Any = asyncio.get_running_loop()
            async with lidar.scans() as stream:
                await anext(stream)
                pulled = loop.turns
                cable.pull()
                loop.call_later(OUT_S, cable.plug)
                while not lidar.stats.reconnects:
                    await anext(stream)

        turns = run_and_close(rig, work, at, what, monkeypatch)
    return pulled, turns, rig, cable


@both_families
@pytest.mark.parametrize("what", [cancel_again_and_again, interrupt])
@pytest.mark.exhaustive("points", sample=[2], full=[12])
def test_ended_at_every_turn_of_coming_back(
    family: str, what: Interrupt, points: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, turns, _, _ = ended_at(family, 1, never, monkeypatch)
    for at in range(first + 1, turns, max(1, (turns - first) // points)):
        _, _, rig, cable = ended_at(family, at, what, monkeypatch)
        # While the cable is out nobody can stop a device that has power of its own; this one has none then.
        if cable.device is not None:
            assert not rig.device.scanning, at
            assert not rig.device.motor_on, at
