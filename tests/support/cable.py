"""A cable in memory, between sessions and simulated devices: it can be pulled out, and put into another device."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import pytest

from lidario import ConnectFailed, Lidar, Scan, ScanStream
from lidario.port import simulated
from lidario.port.port import Port
from lidario.port.simulated import MemoryTransport
from lidario.sim.memory import MemoryLine
from tests.support.devices import Rig, make_rig
from tests.support.loop import now, now_ns


class Cable:
    """What a session on `rig.device` is connected by, as often as it connects."""

    def __init__(self, rig: Rig) -> None:
        self.device: Any = rig.device  # what is at its other end; None while it is pulled out
        self.attempts: list[float] = []  # when it was tried to connect, on the loop's clock
        self.whys: tuple[str, ...] = ("no such port",)  # why that fails while it is pulled out, in turn
        self.rig = rig  # the device that it belongs to
        self.ports: list[Port] = []  # the session's end of each line that was connected, and the latest last
        self._lines: list[MemoryTransport] = []
        self._connect = simulated.connect_in_memory

    def connect(self, device: Any, faults: Any = None, *, name: str = "memory") -> Port:
        """In place of `connect_in_memory`."""
        if device is not self.rig.device:
            return self._connect(device, faults, name=name)
        self.attempts.append(now())
        if self.device is None:
            raise ConnectFailed(self.whys[len(self.attempts) % len(self.whys)], reason="missing")
        port = Port(name, self.device.baudrate)
        line = MemoryTransport(asyncio.get_running_loop(), port, MemoryLine(self.device, faults))
        port.connection_made(line)
        self.ports.append(port)
        self._lines.append(line)
        return port

    def pull(self) -> None:
        """Pull it out: the port dies."""
        self.device = None
        for line in self._lines:
            line.end(OSError("the line was unplugged"))

    def plug(self, device: Any = None, *, boots: bool = True) -> None:
        """Put it in again, into `device` or the one from before, which is switched on by that and boots."""
        self.device = device or self.rig.device
        if boots:
            self.device.reboot(now_ns())


@contextmanager
def cable_to(rig: Rig) -> Iterator[Cable]:
    """The cable to `rig.device` for all sessions that are opened in the block."""
    cable = Cable(rig)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulated, "connect_in_memory", cable.connect)
        yield cable


@asynccontextmanager
async def on_a_cable(rig: Rig | str, **options: Any) -> AsyncIterator[tuple[Cable, Lidar]]:
    """The cable to a device, and a session that is open and comes back, unless the options say otherwise."""
    rig = make_rig(rig) if isinstance(rig, str) else rig
    with cable_to(rig) as cable:
        async with rig.open(**{"reconnect": True, **options}) as lidar:
            yield cable, lidar


async def next_after(stream: ScanStream, moment: float) -> Scan:
    """The first scan that was measured after `moment`."""
    while True:
        scan = await asyncio.wait_for(anext(stream), 30.0)
        if scan.stamp_ns > moment * 1e9:
            return scan
