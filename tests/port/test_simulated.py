"""Lines to simulated devices: on the loop's clock, and the device that fails in the middle."""

import asyncio
import errno
import logging
import os
import sys
import threading
from math import inf
from typing import Any

import pytest

from lidario import DeviceLost, open_lidar
from lidario.basics.source import parse_source
from lidario.errors import ConnectFailed
from lidario.port.port import Port
from lidario.port.serial import open_serial
from lidario.port.simulated import Simulation, connect_in_memory, make_device
from lidario.sim.serve import usual_way
from tests.support.devices import both_families, make_rig
from tests.support.leaks import leaves_nothing
from tests.support.loop import driven, run_driven, until
from tests.support.ports import PATIENCE_S, Sink, open_files
from tests.support.refused import refused


class Mistake(Exception):
    """Raised inside a simulated device."""


class Broken:
    """A simulated device of a user's, with a mistake in one method that shows when it has been called so often."""

    def __init__(self, where: str, calls: float = 0) -> None:
        self.baudrate = 1_000_000
        self.log: list[Any] = []
        self.scanning = self.motor_on = False
        self._where = where
        self.calls = calls

    def receive(self, data: bytes, now: int) -> None:
        self._step("receive")

    def transmit(self, now: int) -> bytes:
        self._step("transmit")
        return b"\x55"

    def wakeup(self, now: int) -> int | None:
        self._step("wakeup")
        return now + 1_000_000

    def _step(self, where: str) -> None:
        if where == self._where:
            self.calls -= 1
            if self.calls < 0:
                raise Mistake("in a user's world")


def check(error: DeviceLost | None) -> None:
    assert error is not None
    assert "the simulated device" in str(error)
    assert "failed: Mistake: in a user's world" in str(error)
    assert isinstance(error.__cause__, Mistake)


@pytest.mark.parametrize(("platform", "way"), [("linux", "pty"), ("darwin", "tcp"), ("win32", "tcp")])
def test_a_way_that_the_system_has_is_the_default(monkeypatch: pytest.MonkeyPatch, platform: str, way: str) -> None:
    """On macOS a pseudo-terminal refuses the speed of most models."""
    monkeypatch.setattr(sys, "platform", platform)
    assert usual_way(make_device(parse_source("sim://rplidar-s2"))[0]) == way


@pytest.mark.parametrize("calls", [0, 3])
@pytest.mark.parametrize("where", ["receive", "transmit", "wakeup"])
@driven
async def test_a_mistake_in_a_device_in_memory_ends_the_port(where: str, calls: int) -> None:
    port, sink = connect_in_memory(Broken(where, calls)), Sink()
    port.attach(sink)
    for _ in range(5):
        port.write(b"request")
    check(await sink.until_lost())
    assert not port.is_open
    port.write(b"ignored")
    await port.close()
    assert len(sink.lost) == 1


@driven
async def test_a_device_in_memory_is_polled_once_in_2_ms_at_most() -> None:
    port, sink = connect_in_memory(Broken("")), Sink()
    port.attach(sink)
    port.write(b"request")
    await asyncio.sleep(0.1)
    await port.close()
    assert 49 <= len(sink.data) <= 51


@driven
async def test_while_a_stream_runs_it_is_read_as_seldom_as_a_line_of_the_system() -> None:
    """When a revolution is complete, and before 4 KiB would have come."""
    rig, reads = make_rig("rplidar-s2"), list[int]()
    async with rig.read() as (lidar, stream):
        for _ in range(3):
            await anext(stream)
        lidar.tap(lambda _, data, now: reads.append(len(data)))
        scans = [await anext(stream) for _ in range(10)]
    assert [scan.lost_packets for scan in scans] == [0] * 10
    # Of 6.7 kB a revolution. Each 2 ms there were fifty.
    assert 10 <= len(reads) <= 45
    assert max(reads) <= 4096


@driven
async def test_a_device_that_fails_at_stop_is_told_although_the_port_is_being_closed() -> None:
    port, sink = connect_in_memory(Broken("receive")), Sink()
    port.attach(sink)
    port.is_closing = True
    port.write(b"stop")
    port.close_soon()
    await port.wait_closed()
    check(await sink.until_lost())


@pytest.mark.parametrize("where", ["receive", "transmit"])
@pytest.mark.parametrize("way", ["pty", "tcp"])
async def test_a_mistake_in_a_served_device_is_the_cause_of_the_loss(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, way: str, where: str
) -> None:
    caplog.set_level(logging.WARNING)
    device = Broken(where, inf)
    monkeypatch.setattr("lidario.port.simulated.make_device", lambda source: (device, None))
    before = threading.active_count(), open_files()
    port, sink = await Simulation(parse_source(f"sim://rplidar-s2?via={way}"), lasting=False).open(), Sink()
    port.attach(sink)
    device.calls = 3  # only now: its thread may be ahead of the opening
    async with asyncio.timeout(PATIENCE_S):
        while not sink.lost:
            port.write(b"request")
            await asyncio.sleep(0.005)
    check(await sink.until_lost())
    await port.close()
    # Its thread was told to end, and may need a moment.
    await until(lambda: (threading.active_count(), open_files()) == before)
    # It is told once, and nothing is left for the loop's exception handler.
    assert caplog.records == []


async def test_a_device_that_fails_before_its_line_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    async def open_late(path: str, baudrate: int) -> Port:
        await until(lambda: not os.path.exists(path))
        return await open_serial(path, baudrate)

    monkeypatch.setattr("lidario.port.simulated.make_device", lambda source: (Broken("transmit"), None))
    monkeypatch.setattr("lidario.port.simulated.open_serial", open_late)
    with pytest.raises(DeviceLost) as caught:
        await Simulation(parse_source("sim://rplidar-s2?via=pty"), lasting=False).open()
    check(caught.value)


@pytest.mark.parametrize("moment", ["opening", "scanning"])
@driven
async def test_a_session_ends_with_the_users_mistake(moment: str) -> None:
    rig = make_rig("rplidar")
    transmit, broken = rig.device.transmit, moment == "opening"

    def failing(now: int) -> bytes:
        if broken:
            raise Mistake("in a user's world")
        data: bytes = transmit(now)
        return data

    rig.device.transmit = failing
    with pytest.raises(DeviceLost, match="simulated device") as caught:
        async with rig.open() as lidar:
            async for _ in lidar.scans():
                broken = True
    causes: list[BaseException | None] = [caught.value]
    while causes[-1] is not None:
        causes.append(causes[-1].__cause__)
    assert isinstance(causes[-2], Mistake)


async def test_a_failure_of_what_ends_with_the_port_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    port = connect_in_memory(Broken(""))

    def fail() -> None:
        raise Mistake("while ending")

    port.on_close = fail
    await port.close()
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    assert record.exc_info
    assert isinstance(record.exc_info[1], Mistake)


@both_families
@driven
async def test_a_device_in_memory_is_opened_for_nobody_else_beside(family: str) -> None:
    """As a serial port: two sessions would take each other's bytes, and stop each other's stream."""
    rig = make_rig(family)
    async with rig.open() as first:
        with refused("busy", "another session has it open"):
            await rig.open()
        await first.scan()
    async with rig.open() as second:
        await second.scan()


@pytest.mark.discards("the first session cannot be closed any more, so nobody knows when its STOP was written")
def test_a_device_of_a_loop_that_is_closed_is_free() -> None:
    rig = make_rig("rplidar")
    kept = []

    async def leave_open() -> None:
        kept.append(await rig.open())

    run_driven(leave_open)

    async def again() -> None:
        async with rig.open() as lidar:
            await lidar.scan()

    run_driven(again)
    kept.clear()


@pytest.mark.parametrize(
    "way", [("pty", "os.openpty"), ("tcp", "socket.socket.bind"), ("udp", "socket.socket.bind")]
)
async def test_where_the_system_has_no_way_to_serve_it(
    way: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a container without /dev/pts, or without a loopback interface."""

    def refuse(*_: object) -> None:
        raise OSError(errno.ENODEV, "No such device")

    via, call = way
    monkeypatch.setattr(call, refuse)
    told = rf"^'sim://rplidar-s2\?via={via}' cannot be served: no such device.*via=memory needs no such thing$"
    with pytest.raises(ConnectFailed, match=told):
        await open_lidar(f"sim://rplidar-s2?via={via}")


def test_a_served_device_ends_with_its_port_after_the_loop_was_closed() -> None:
    with leaves_nothing():
        with asyncio.Runner() as runner:
            port = runner.run(Simulation(parse_source("sim://rplidar-s2?via=pty"), lasting=False).open())
        port.close_soon()


@pytest.mark.parametrize("via", ["pty", "tcp", "udp"] if sys.platform == "linux" else ["tcp", "udp"])
async def test_one_that_stays_unplugged_is_not_opened_again(via: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its name or address is free then, and the system gives it to the next one who asks."""
    simulation = Simulation(parse_source(f"sim://rplidar-s2?via={via}"), lasting=True)
    port = await simulation.open()
    server = simulation.server
    assert server is not None
    server.unplug()
    await port.close()
    await port.wait_closed()
    opened: list[object] = []
    for way in ("serial", "tcp", "udp"):
        monkeypatch.setattr(f"lidario.port.simulated.open_{way}", lambda *where, **_: opened.append(where))
    with refused("missing", "is unplugged and stays so"):
        await simulation.open()
    assert not opened
    simulation.end()
