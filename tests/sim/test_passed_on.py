"""A device or a world behind an object that passes on what it is asked for (``__getattr__``) is as good as itself.

Python 3.12 and later no longer find such attributes when `isinstance` compares an object with a protocol.
"""

from __future__ import annotations

from typing import Any

import pytest

import lidario
from lidario.sim.faults import parse_faults
from lidario.sim.memory import MemoryLine
from lidario.sim.rooms import make_world

SECOND = 1_000_000_000
BEGIN = 100 * SECOND


class Behind:
    """Has nothing of its own."""

    def __init__(self, thing: Any) -> None:
        object.__setattr__(self, "thing", thing)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.thing, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self.thing, name, value)


def test_dtr_reaches_the_device() -> None:
    """The motor of an A1 turns while DTR is cleared."""
    device = lidario.simulate("rplidar-a1", spin_up=0)
    line = MemoryLine(Behind(device), None)
    for number, asserted in enumerate((True, False, True)):
        line.set_dtr(asserted, BEGIN + number * SECOND)
        assert device.motor_on is not asserted


def test_the_speed_of_the_port_reaches_the_device() -> None:
    replies = []
    for baudrate in (1_000_000, 115_200):
        line = MemoryLine(Behind(lidario.simulate("rplidar-s2")), None)
        line.set_baudrate(baudrate, BEGIN)
        line.write(b"\xa5\x52", BEGIN)
        replies.append(line.read(BEGIN + SECOND)[:2])
    assert replies[0] == b"\xa5\x5a" != replies[1]


@pytest.mark.discards("a device that is frozen discards requests")
def test_its_faults_happen() -> None:
    line = MemoryLine(Behind(lidario.simulate("rplidar-s2")), parse_faults("freeze:1s", seed=0))
    line.write(b"\xa5\x52", BEGIN)
    assert line.read(BEGIN + SECOND // 2)
    line.write(b"\xa5\x52", BEGIN + 2 * SECOND)
    assert not line.read(BEGIN + 3 * SECOND)


def test_a_world_is_measured() -> None:
    assert lidario.simulate("rplidar-s2", world=Behind(make_world("room", seed=0)))
