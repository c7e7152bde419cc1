"""From a source to the first scan: how long lidario itself takes, on a driven clock.

The devices are simulated and in memory, on lines that garble what is sent at one speed and read at another. The
clock is driven, so the machine's own speed is not in it, and every run gives the same figures. What the device
takes is in it: a rotor that rests needs one second in the simulation, and the first whole revolution follows a
partial one.
"""

from __future__ import annotations

import asyncio
from typing import Any, NamedTuple

import pytest

from benchmarks.report import Table
from lidario import open_lidar
from tests.support.devices import MAKERS, leave_streaming
from tests.support.loop import run_driven
from tests.support.speeds import serial_in_memory

_PORT = "/dev/ttyUSB0"


class Case(NamedTuple):
    """A way to open a device.

    Attributes:
        family: Its family.
        named: Whether family and speed are named.
        streams: Whether it still streams for a program that was killed.
    """

    family: str
    named: bool
    streams: bool

    @property
    def name(self) -> str:
        """In words."""
        state = "after kill -9" if self.streams else "at rest"
        return f"{MAKERS[self.family].model}, {'everything named' if self.named else 'path only'}, {state}"


CASES = [Case(family, named, streams) for family in MAKERS for named in (False, True) for streams in (False, True)]


def first_scan_s(case: Case) -> float:
    """Seconds from `open_lidar` to the first scan."""
    make, model, *_ = MAKERS[case.family]
    device: Any = make(model)
    named: dict[str, Any] = {"family": case.family, "baudrate": device.baudrate} if case.named else {}

    async def main() -> float:
        loop = asyncio.get_running_loop()
        if case.streams:
            leave_streaming(device, round(loop.time() * 1e9), 0)
        began = loop.time()
        async with open_lidar(_PORT, **named) as lidar:
            await lidar.scan()
            return loop.time() - began

    with pytest.MonkeyPatch.context() as patch:
        serial_in_memory(patch, **{_PORT: device})
        return run_driven(main)


def table() -> tuple[Table, dict[str, float]]:
    """The table, and its figures."""
    took = {case.name: first_scan_s(case) for case in CASES}
    found = Table("start: from a source to the first scan, on a driven clock", ["device", "s"])
    found.rows += [[name, f"{seconds:.2f}"] for name, seconds in took.items()]
    found.notes.append("simulated rotors need 1 s from rest; the time of the machine itself is not in it")
    return found, took
