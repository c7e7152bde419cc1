"""What the driver of a serial port has counted, from the system call to the port."""

import os

import pytest

from lidario.basics.model import LineErrors
from lidario.port.adapter import count_errors
from lidario.port.serial import open_serial
from tests.support.drivers import FakeDriver
from tests.support.ports import opened


@pytest.fixture
def driver(ends: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch) -> FakeDriver:
    return FakeDriver(ends[2], monkeypatch)


async def test_what_was_counted_since_the_opening(ends: tuple[int, int, str], driver: FakeDriver) -> None:
    driver.counted = {"frame": 100, "overrun": 20, "parity": 30, "brk": 40, "buf_overrun": 50}
    port = await open_serial(ends[2], 115200)
    assert port.errors == LineErrors()
    driver.counted = {"frame": 101, "overrun": 22, "parity": 33, "brk": 44, "buf_overrun": 55}
    # What the adapter and what the system could not keep is lost alike.
    assert port.errors == LineErrors(framing=1, overruns=2 + 5, parity=3, breaks=4)
    driver.counted["frame"] += 9
    await port.close()
    # The last ones count, too.
    assert port.errors == LineErrors(framing=10, overruns=7, parity=3, breaks=4)
    driver.counted["frame"] += 1000
    assert port.errors.framing == 10


async def test_the_last_counts_outlive_the_adapter(ends: tuple[int, int, str], driver: FakeDriver) -> None:
    driver.counted = {"frame": 0}
    async with opened(ends[2]) as (port, sink):
        driver.counted = {"frame": 6}
        assert port.errors.framing == 6
        driver.gone = True
        assert port.errors.framing == 6
        for end in ends[:2]:
            os.close(end)
        await sink.until_lost()
        assert port.errors.framing == 6


def test_other_systems_count_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.delattr("termios.TIOCGICOUNT")
        assert count_errors(-1) == LineErrors()
    with monkeypatch.context() as patch:
        patch.setattr("os.name", "nt")
        windows = count_errors(-1)
    assert windows == LineErrors()
    with pytest.raises(ValueError, match="file descriptor"):
        count_errors(-1)


@pytest.mark.parametrize(
    ("errors", "meaning"),
    [
        (LineErrors(), ""),
        (LineErrors(framing=1), "1 framing error: the baud rate is wrong or the cable is bad"),
        (LineErrors(breaks=2), "2 breaks: the baud rate is wrong or the cable is bad"),
        (LineErrors(overruns=1), "1 overrun: this computer is too slow for the line"),
        (
            LineErrors(framing=12, parity=2, overruns=3, breaks=1),
            "12 framing errors, 2 parity errors, 1 break: the baud rate is wrong or the cable is bad; "
            "3 overruns: this computer is too slow for the line",
        ),
    ],
)
def test_what_it_means(errors: LineErrors, meaning: str) -> None:
    assert errors.meaning() == meaning
