"""DTR of a serial port: set when asked, kept when the port is closed, survived where there is none."""

from __future__ import annotations

import os
import termios

import pytest
import serial

from lidario import open_lidar, simulate
from lidario.port.port import Port
from lidario.port.serial import open_serial
from lidario.port.simulated import connect_in_memory
from tests.support.ports import Sink, written
from tests.support.terminals import WaitingPtyServer


@pytest.fixture
def states(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """The states in which DTR was put, at ports that have such a line."""
    found: list[bool] = []
    monkeypatch.setattr(serial.Serial, "_update_dtr_state", lambda port: found.append(port.dtr))
    return found


def hangs_up(handle: int) -> bool:
    return bool(termios.tcgetattr(handle)[2] & termios.HUPCL)


async def test_asserted_it_outlasts_the_close(ends: tuple[int, int, str], states: list[bool]) -> None:
    _, slave, path = ends
    settings = termios.tcgetattr(slave)
    settings[2] |= termios.HUPCL
    termios.tcsetattr(slave, termios.TCSANOW, settings)
    port = await open_serial(path, 115200)
    assert (states, hangs_up(slave)) == ([False], True)
    port.set_dtr(False)
    assert hangs_up(slave)
    port.set_dtr(True)
    assert states == [False, False, True]
    assert not hangs_up(slave)
    port.set_baudrate(256000)
    await port.close()
    assert not hangs_up(slave)
    assert states[-1] is True
    port.set_dtr(False)
    assert len(states) == 3


async def test_a_pseudo_terminal_has_none_and_works_all_the_same(ends: tuple[int, int, str]) -> None:
    master, _, path = ends
    port, sink = await open_serial(path, 115200), Sink()
    port.attach(sink)
    for asserted in (True, False):
        port.set_dtr(asserted)
    port.write(b"out")
    assert written(master, 3) == b"out"
    os.write(master, b"in")
    await sink.until(2)
    await port.close()
    assert sink.lost == [None]


async def test_where_there_is_no_line_nothing_happens() -> None:
    port = Port("nothing")
    port.set_dtr(True)
    device = simulate("ydlidar-4ros")
    in_memory = connect_in_memory(device)
    in_memory.set_dtr(True)
    await in_memory.close()


async def test_a_motor_that_dtr_switches_is_off_after_the_session(states: list[bool]) -> None:
    device = simulate("rplidar-a1")
    with WaitingPtyServer(device) as server:
        async with open_lidar(server.path, family="rplidar", baudrate=115200) as lidar:
            assert lidar.info.model == "RPLIDAR A1M8"
            # It turns from the opening on.
            assert states == [False]
        assert states == [False, True]
        handle = os.open(server.path, os.O_RDWR | os.O_NOCTTY)
        try:
            assert not hangs_up(handle)
        finally:
            os.close(handle)
        assert [each.name for each in device.log][-1] == "stop"


async def test_or_on_where_it_shall_go_on(states: list[bool]) -> None:
    device = simulate("rplidar-a1")
    with WaitingPtyServer(device) as server:
        async with open_lidar(server.path, family="rplidar", baudrate=115200, keep_spinning=True):
            pass
        assert states == [False]
