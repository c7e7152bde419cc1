"""What opening and closing a serial port do to its control lines and its driver, seen at the system calls."""

import os
from pathlib import Path

import pytest

from lidario.errors import ConnectFailed, DeviceLost
from lidario.port.adapter import Adapter, latency_ms
from lidario.port.serial import open_serial
from tests.support.drivers import LOW_LATENCY, SPEED_FLAG, FakeDriver
from tests.support.ports import Sink, another_program, opened
from tests.support.refused import refused

RESET = (False, True)
"""DTR low, RTS high: what holds a board with an ESP32 in reset."""


@pytest.fixture
def path(ends: tuple[int, int, str]) -> str:
    return ends[2]


@pytest.fixture
def driver(path: str, monkeypatch: pytest.MonkeyPatch) -> FakeDriver:
    return FakeDriver(path, monkeypatch)


async def test_both_lines_are_low_after_opening_and_no_board_is_reset(path: str, driver: FakeDriver) -> None:
    port = await open_serial(path, 115200)
    assert driver.states[0] == (True, True)
    assert driver.states[-1] == (False, False)
    await port.close()
    assert RESET not in driver.states
    # A driver without low latency is not asked for it.
    assert driver.settings == 0


async def test_rts_stays_low_while_a_motor_is_switched_by_dtr(path: str, driver: FakeDriver) -> None:
    port = await open_serial(path, 115200)
    begun = len(driver.states)
    port.set_dtr(True)
    port.set_baudrate(256000)
    port.set_dtr(False)
    await port.close()
    assert driver.states[begun:] == [(True, False), (False, False)]


async def test_a_port_that_another_program_holds_is_busy_and_keeps_its_lines(
    path: str, driver: FakeDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A pseudo-terminal is exempt, since its other end holds it; here it is taken for a real port.
    monkeypatch.setattr("lidario.port.serial.is_pseudo_terminal", lambda path: False)
    with another_program(path) as other, refused("busy", f"PID {other.pid} "):
        await open_serial(path, 115200)
    assert driver.states == []


@pytest.fixture
def ftdi(path: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeDriver:
    """A driver that has a latency timer, at 16 ms."""
    return FakeDriver(path, monkeypatch, tmp_path)


async def test_low_latency_holds_while_the_port_is_open(path: str, ftdi: FakeDriver, tmp_path: Path) -> None:
    port = await open_serial(path, 115200)
    assert ftdi.flags == SPEED_FLAG | LOW_LATENCY
    assert latency_ms(path, tmp_path) == 1
    port.set_baudrate(256000)
    await port.close()
    assert ftdi.flags == SPEED_FLAG
    assert ftdi.settings == 2
    assert latency_ms(path, tmp_path) == 16


async def test_it_is_given_back_by_a_port_that_nobody_closed(path: str, ftdi: FakeDriver) -> None:
    port, sink = await open_serial(path, 115200), Sink()
    port.attach(sink)
    port.abandon(b"")
    assert await sink.until_lost() is None
    assert ftdi.flags == SPEED_FLAG


async def test_a_pulled_out_adapter_has_nothing_to_be_given(ends: tuple[int, int, str], ftdi: FakeDriver) -> None:
    async with opened(ends[2]) as (_, sink):
        ftdi.gone = True
        for end in ends[:2]:
            os.close(end)
        assert isinstance(await sink.until_lost(), DeviceLost)
        assert ftdi.settings == 1


@pytest.mark.parametrize(("before", "fails"), [(SPEED_FLAG | LOW_LATENCY, False), (SPEED_FLAG, True)])
async def test_who_finds_it_set_or_is_refused_leaves_it_as_it_is(
    before: int, fails: bool, path: str, ftdi: FakeDriver
) -> None:
    """Set it is also found by the next program after one that was killed; unplugging ends it."""
    ftdi.flags, ftdi.fails = before, fails
    ftdi.show_latency()
    port = await open_serial(path, 115200)
    ftdi.fails = False
    await port.close()
    assert (ftdi.flags, ftdi.settings) == (before, 0)


async def test_a_second_one_changes_nothing(path: str, ftdi: FakeDriver) -> None:
    first = await open_serial(path, 115200)
    with pytest.raises(ConnectFailed, match="busy"):
        await open_serial(path, 115200)
    assert ftdi.flags & LOW_LATENCY
    assert ftdi.settings == 1
    await first.close()
    assert ftdi.flags == SPEED_FLAG


def test_a_forked_child_gives_nothing_back(path: str, ftdi: FakeDriver, tmp_path: Path) -> None:
    device = Adapter()
    device.port = path
    device.open()
    device.hurry()
    child = os.fork()
    if not child:
        device.close()
        os._exit(0)
    os.waitpid(child, 0)
    # The child would have written it in the folder that both share.
    assert latency_ms(path, tmp_path) == 1
    device.close()
    assert latency_ms(path, tmp_path) == 16


@pytest.mark.parametrize("text", ["", "soon", "-1", "1.5"])
def test_a_timer_that_makes_no_sense_is_none(path: str, ftdi: FakeDriver, tmp_path: Path, text: str) -> None:
    (tmp_path / "sys/class/tty" / os.path.basename(path) / "device/latency_timer").write_text(text)
    assert latency_ms(path, tmp_path) is None
    assert latency_ms("/dev/no-such-port", tmp_path) is None
