"""What the driver of a serial port has counted, in the counters of a session and in what its errors say."""

import asyncio
import json
from weakref import WeakKeyDictionary

import numpy as np
import pytest

from lidario.basics.model import LineErrors
from lidario.port.port import Port
from tests.cli.processes import invoke_driven
from tests.support.cable import next_after, on_a_cable
from tests.support.devices import Rig, end_of, left_still, scanning
from tests.support.loop import now


class Counted:
    """What every port has counted, of which a memory has no driver."""

    def __init__(self, patch: pytest.MonkeyPatch, *, each_time: int = 0) -> None:
        self.errors = LineErrors(framing=900, overruns=90, breaks=9)
        self._each_time = each_time
        self._last: WeakKeyDictionary[Port, LineErrors] = WeakKeyDictionary()
        patch.setattr(Port, "errors", property(self._of))

    def _of(self, port: Port) -> LineErrors:
        self.errors += LineErrors(framing=self._each_time)
        if port.is_open or port not in self._last:
            self._last[port] = self.errors
        return self._last[port]


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counted:
    return Counted(monkeypatch)


async def test_they_are_in_stats_from_the_beginning_of_the_session(rig: Rig, counted: Counted) -> None:
    async with rig.open() as lidar:
        # What came before, at other speeds, says nothing of this one.
        assert lidar.stats.line_trouble == ""
        counted.errors += LineErrors(framing=5, parity=4, overruns=3, breaks=2)
        stats = lidar.stats
        assert (stats.framing_errors, stats.parity_errors, stats.overruns, stats.breaks) == (5, 4, 3, 2)
        assert stats.line_trouble.startswith("5 framing errors, 4 parity errors, 2 breaks: the baud rate")
        assert (await lidar.scan()).seq == 0


@pytest.mark.long
async def test_they_are_summed_over_all_lines(counted: Counted) -> None:
    async with on_a_cable("rplidar") as (cable, lidar), scanning(lidar) as stream:
        counted.errors += LineErrors(framing=5)
        # Whoever watches the stream asks, too: the driver of an adapter that is gone tells nothing.
        await asyncio.sleep(2.0)
        cable.pull()
        await asyncio.sleep(3.0)
        assert lidar.stats.framing_errors == 5
        # Of a line that is gone nothing is counted any more, and a new one begins with what it finds.
        counted.errors += LineErrors(framing=100)
        cable.plug()
        await next_after(stream, now())
        assert (lidar.stats.reconnects, lidar.stats.framing_errors) == (1, 5)
        counted.errors += LineErrors(framing=2)
        assert lidar.stats.framing_errors == 7


@pytest.mark.parametrize(
    ("errors", "says"),
    [
        (LineErrors(), "; only noise arrives: is the baud rate right?"),
        (LineErrors(framing=7), "; only noise arrives, with 7 framing errors: the baud rate is wrong or the cable"),
        (LineErrors(overruns=7), "; only noise arrives, with 7 overruns: this computer is too slow"),
    ],
)
async def test_noise_is_told_with_them_and_leaves_the_device_still_at_once(
    rig: Rig, counted: Counted, errors: LineErrors, says: str
) -> None:
    """Also where its reader goes on holding the stream, and before the session ends; which can go on."""
    random = np.random.default_rng(3)
    async with rig.read() as (lidar, stream):
        clean = rig.device.transmit
        rig.device.transmit = lambda now: random.bytes(len(clean(now)))
        counted.errors += errors
        assert says in str(await end_of(stream))
        assert lidar.stats.skipped_bytes > 10_000
        rig.device.transmit = clean
        await asyncio.sleep(0.2)
        assert left_still(rig)
        assert not lidar.is_scanning
        assert await lidar.scan()


@pytest.mark.long
def test_the_doctor_and_the_measuring_tell_them(monkeypatch: pytest.MonkeyPatch) -> None:
    Counted(monkeypatch, each_time=1)
    told = json.loads(invoke_driven("doctor", "sim://rplidar-s2?via=memory", "--json").stdout)
    (found,) = [each for each in told if each["what"] == "driver"]
    assert found["state"] == "hint"
    assert "framing errors: the baud rate is wrong or the cable is bad" in found["text"]
    told = json.loads(invoke_driven("stats", "sim://rplidar-s2?via=memory", "-t", "1s", "--json").stdout)
    assert told["framing_errors"] > 0
    assert (told["overruns"], told["parity_errors"], told["breaks"]) == (0, 0, 0)
