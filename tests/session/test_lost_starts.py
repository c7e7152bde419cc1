"""A damaged line loses the request that starts a stream, or the response to it, and damages what is told."""

import asyncio
from functools import partial
from typing import Any

import pytest

from lidario import (
    ConnectFailed,
    Health,
    LidarError,
    ResponseTimeout,
    ScanMode,
    StreamFailed,
    Unsupported,
    open_lidar,
)
from tests.support.cable import next_after
from tests.support.devices import MAKERS, Rig, call, end_of, names, scanning
from tests.support.loop import now, run_driven
from tests.support.samples import long_but_some
from tests.support.times import takes

STARTS = (b"\xa5\x20", b"\xa5\x82", b"\xa5\x83", b"\xa5\x60", b"MD")
"""How the requests begin that start a stream."""
KINDS = [(name, None) for name, maker in MAKERS.items() if maker.obeys] + [("rplidar-c1", "Standard")]
kinds = pytest.mark.parametrize(
    ("rig", "mode"), long_but_some(*KINDS), ids=[name for name, _ in KINDS], indirect=["rig"]
)
FOREVER = 1000


class PoorLine:
    """Flips a bit of some requests that start a stream, or of what responds to them."""

    def __init__(self, rig: Rig, way: str) -> None:
        self.left = 0  # how many are still to be damaged
        self._way = way
        self._responds = False
        self._device: Any = rig.device
        self._receive, self._transmit = self._device.receive, self._device.transmit
        self._device.receive, self._device.transmit = self.receive, self.transmit

    def receive(self, data: bytes, at: int) -> None:
        if self.left and data.startswith(STARTS):
            self.left -= 1
            if self._way == "request":
                data = bytes((data[0] ^ 1, *data[1:]))
            else:
                self._responds = True
        self._receive(data, at)

    def transmit(self, at: int) -> bytes:
        data: bytes = self._transmit(at)
        if data and self._responds:
            self._responds = False
            data = bytes((data[0] ^ 1, *data[1:]))
        return data


@kinds
@pytest.mark.parametrize("way", ["request", "response"])
async def test_two_starts_that_are_lost_in_a_row_end_nothing(rig: Rig, mode: str | None, way: str) -> None:
    line = PoorLine(rig, way)
    async with rig.open() as lidar:
        line.left = 2
        async with lidar.scans(mode) as stream:
            first = await anext(stream)
            assert line.left == 0
            line.left = 2
            await lidar.get_health()
            await next_after(stream, first.stamp_ns * 1e-9 + 2.0)
            assert line.left == 0
        assert lidar.stats.restarts <= 2


@kinds
async def test_starts_that_are_always_lost_end_the_stream_in_a_bounded_time(rig: Rig, mode: str | None) -> None:
    line = PoorLine(rig, "request")
    async with rig.open() as lidar:
        line.left = FOREVER
        with takes(20.0), pytest.raises(ResponseTimeout):
            await lidar.scan(mode)
        assert lidar.stats.restarts == 3
        line.left = 0
        async with scanning(lidar, mode) as stream:
            line.left = FOREVER
            await lidar.get_health()
            await end_of(stream, StreamFailed, "could not be started again")
        line.left = 0
        assert await lidar.scan(mode)


async def test_a_device_that_does_not_begin_is_asked_whether_protection_was_left_on(ydlidar: Rig) -> None:
    line = PoorLine(ydlidar, "request")
    async with ydlidar.open() as lidar:
        line.left = 2
        await lidar.scan()
    assert names(ydlidar).count("toggle_protection") == 2


async def test_a_mode_that_is_not_listed_and_starts_nothing_is_told_of_at_once(rplidar: Rig) -> None:
    line = PoorLine(rplidar, "request")
    async with rplidar.open() as lidar:
        line.left = FOREVER
        with takes(5.0), pytest.raises(ResponseTimeout, match="HQ_SCAN"):
            await lidar.scan("HQ scan")
        assert lidar.stats.restarts == 0


@pytest.mark.parametrize("question", ["get_info", "get_health"])
@kinds
async def test_another_task_gets_its_response_behind_a_lost_start(
    rig: Rig, mode: str | None, question: str
) -> None:
    """The device may scan all the same, and would not hear the question."""
    line = PoorLine(rig, "response")
    async with rig.open() as lidar:
        line.left = 2
        async with lidar.scans(mode) as stream:
            reading = asyncio.ensure_future(anext(stream))
            await asyncio.sleep(0.1)
            assert await call(lidar, question)
            assert line.left == 0
            assert len(await reading) > 100
        assert names(rig, obeyed=False) == []


SEEDS = 12
MODELS = ["rplidar-s2", "rplidar-a1", "rplidar-express", "ydlidar-4ros"]


def told(model: str, fault: str) -> tuple[tuple[ScanMode, ...], Health, float | None] | None:
    """What a device tells of itself; None where the line lets nothing through."""

    async def main() -> tuple[tuple[ScanMode, ...], Health, float | None] | None:
        try:
            async with open_lidar(f"sim://{model}?via=memory{fault}") as lidar:
                try:
                    frequency = await lidar.get_scan_frequency()
                except Unsupported:
                    frequency = None
                return await lidar.get_modes(), await lidar.get_health(), frequency
        except ConnectFailed:
            raise
        except LidarError:
            return None

    return run_driven(main)


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_what_is_told_is_believed_when_it_comes_twice(model: str, caplog: pytest.LogCaptureFixture) -> None:
    """Responses carry no check value, and the line damages them."""
    clean = told(model, "")
    assert clean is not None
    modes, health, frequency = clean
    answered = 0
    for seed in range(SEEDS):
        caplog.clear()
        found = told(model, f"&seed={seed}&fault=flip:1%25")
        if found is None:
            continue
        answered += 1
        assert "stopped to protect itself" not in caplog.text
        assert found[0] == modes or "did not tell" in caplog.text, seed
        assert found[1] == health, seed
        assert found[2] == frequency, seed
    assert answered > SEEDS / 2


@pytest.mark.parametrize("model", ["rplidar-s2", "rplidar-a1"])
def test_to_ask_until_two_are_alike_takes_a_bounded_time(model: str) -> None:
    """Where most questions have no response, or one that is late, too."""

    async def main(seed: int) -> float:
        device = f"sim://{model}?via=memory&seed={seed}&fault=late:700ms,wrong-response:40%25,drop:1%25"
        try:
            async with open_lidar(device) as lidar:
                began = now()
                await lidar.get_modes()
                return now() - began
        except LidarError:
            return 0.0

    assert 5.0 < max(run_driven(partial(main, seed)) for seed in range(12)) < 60.0
