"""What opening and closing a serial port do to its control lines, seen at the system calls."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

from lidario.errors import ConnectFailed
from lidario.port.serial import open_serial
from tests.support.drivers import FakeDriver
from tests.support.ports import another_program, terminal_pair

HOLD = "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print(flush=True); sys.stdin.read()"
RESET = (False, True)
"""DTR low, RTS high: what holds a board with an ESP32 in reset."""


@pytest.fixture
def path() -> Iterator[str]:
    with terminal_pair() as (_, _, found):
        yield found


@pytest.fixture
def driver(path: str, monkeypatch: pytest.MonkeyPatch) -> FakeDriver:
    return FakeDriver(path, monkeypatch)


async def test_both_lines_are_low_after_opening_and_no_board_is_reset_on_the_way(
    path: str, driver: FakeDriver
) -> None:
    port = await open_serial(path, 115200)
    assert driver.states[0] == (True, True)
    assert driver.states[-1] == (False, False)
    assert RESET not in driver.states
    await port.close()
    assert RESET not in driver.states


async def test_rts_stays_low_while_a_motor_is_switched_by_dtr(path: str, driver: FakeDriver) -> None:
    port = await open_serial(path, 115200)
    begun = len(driver.states)
    port.set_dtr(True)
    port.set_baudrate(256000)
    port.set_dtr(False)
    await port.close()
    assert driver.states[begun:] == [(True, False), (False, False)]


async def test_a_port_that_another_program_holds_keeps_its_lines(
    path: str, driver: FakeDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A pseudo-terminal is exempt, since its other end holds it; here it is taken for a real port.
    monkeypatch.setattr("lidario.port.serial.is_pseudo_terminal", lambda path: False)
    with (
        another_program([sys.executable, "-c", HOLD, path]),
        pytest.raises(ConnectFailed, match="busy: held by PID"),
    ):
        await open_serial(path, 115200)
    assert driver.states == []
