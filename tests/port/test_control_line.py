"""DTR of a serial port: set when asked, kept when the port is closed."""

import asyncio
import os
import termios

import pytest

from lidario import open_lidar, simulate
from lidario.port.serial import open_serial
from tests.support.drivers import FakeDriver
from tests.support.ports import written
from tests.support.terminals import WaitingPtyServer

OPENED = [True, True, False]
"""DTR: Linux raises it when the port is opened, then RTS is cleared, and then DTR."""


def states(driver: FakeDriver) -> list[bool]:
    """Of DTR, one after the other."""
    return [dtr for dtr, _ in driver.states]


def hangs_up(handle: int) -> bool:
    return bool(termios.tcgetattr(handle)[2] & termios.HUPCL)


async def test_asserted_it_outlasts_the_close(ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch) -> None:
    _, slave, path = ends
    driver = FakeDriver(path, monkeypatch)
    settings = termios.tcgetattr(slave)
    settings[2] |= termios.HUPCL
    termios.tcsetattr(slave, termios.TCSANOW, settings)
    port = await open_serial(path, 115200)
    assert (states(driver), hangs_up(slave)) == (OPENED, True)
    port.set_dtr(False)
    assert hangs_up(slave)
    port.set_dtr(True)
    assert states(driver) == [*OPENED, False, True]
    assert not hangs_up(slave)
    port.set_baudrate(256000)
    await port.close()
    assert not hangs_up(slave)
    assert states(driver)[-1] is True
    port.set_dtr(False)
    assert len(states(driver)) == len(OPENED) + 2


def test_it_is_set_behind_the_stop_requests_where_the_loop_was_closed(
    ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some models hear nothing while it is asserted."""
    master, _, path = ends
    driver = FakeDriver(path, monkeypatch)
    before: list[tuple[float, bytes, list[bool]]] = []
    monkeypatch.setattr(
        "lidario.port.port.time.sleep", lambda for_s: before.append((for_s, written(master, 4), states(driver)))
    )
    with asyncio.Runner() as runner:
        port = runner.run(open_serial(path, 115200))
    port.abandon(b"stop", dtr=True)
    assert before == [(0.01, b"stop", OPENED)]
    assert states(driver) == [*OPENED, True]


@pytest.mark.parametrize("keep_spinning", [False, True])
async def test_a_motor_that_dtr_switches_is_off_after_the_session_or_on_where_it_shall_go_on(
    keep_spinning: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    how = {"family": "rplidar", "baudrate": 115200, "keep_spinning": keep_spinning}
    device = simulate("rplidar-a1")
    with WaitingPtyServer(device) as server:
        driver = FakeDriver(server.path, monkeypatch)
        async with open_lidar(server.path, **how) as lidar:  # type: ignore[arg-type]
            assert lidar.info.model == "RPLIDAR A1M8"
            # It turns from the opening on.
            assert states(driver) == OPENED
        assert states(driver) == [*OPENED, *[True] * (not keep_spinning)]
        handle = os.open(server.path, os.O_RDWR | os.O_NOCTTY)
        try:
            assert keep_spinning or not hangs_up(handle)
        finally:
            os.close(handle)
        assert [each.name for each in device.log][-1] == "stop"
