"""What goes wrong, and what the session makes of it: on the strict simulated devices, in driven time."""

import asyncio

import numpy as np
import pytest

from lidario import DeviceLost, InternalError, ResponseTimeout, Scan, open_lidar
from lidario.revolution.assemble import Assembler
from lidario.revolution.ended import EndedRevolution
from lidario.revolution.seam import Seam
from tests.support.cable import cable_to
from tests.support.devices import Rig, end_of, leave_streaming, left_still, make_rig, scanning
from tests.support.loop import driven_loop, now_ns


async def test_garbage_for_an_answer_is_asked_again(rig: Rig) -> None:
    async with rig.open() as lidar:
        rig.device.garble_responses = 1
        assert (await lidar.get_info()) == lidar.info
        rig.device.garble_responses = 1000
        with pytest.raises(ResponseTimeout, match="no response to it") as caught:
            await lidar.get_info()
        assert caught.value.noise > 0
        assert isinstance(caught.value, TimeoutError)
        rig.device.garble_responses = 0
        assert (await lidar.get_info()) == lidar.info


@pytest.mark.long
@pytest.mark.exhaustive("connects", sample=[200], full=[1000])
async def test_many_connects_to_a_device_that_still_streams(connects: int) -> None:
    random = np.random.default_rng(7)
    for round_number in range(connects):
        rig = make_rig("rplidar", seed=int(random.integers(1 << 30)))
        loop = driven_loop()
        leftover = int(random.integers(0, 4097))
        leave_streaming(rig.device, now_ns())
        # What the kernel still holds of a killed program's stream: up to 4 KiB, then the device goes on.
        loop.block(leftover / (rig.device.baudrate / 10))
        async with rig.open() as lidar:
            assert lidar.info.model.startswith("RPLIDAR S2"), round_number
        assert left_still(rig)


@pytest.mark.long
async def test_a_line_that_is_never_quiet_is_no_device_that_sends_on(monkeypatch: pytest.MonkeyPatch) -> None:
    async with open_lidar("sim://rplidar-s2?via=memory&fault=babble:1000&seed=3") as lidar:
        # As if too little came through for a scan.
        monkeypatch.setattr(EndedRevolution, "is_broken", lambda *_: True)
        await end_of(lidar.scans(), why="after 3 STOP requests: the device does not hear them, or it is noise")
        monkeypatch.undo()


@pytest.mark.long
async def test_a_lost_line_ends_every_stream_and_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    """Also where it comes back: nobody has asked the session to go on."""
    async with open_lidar("sim://rplidar-s2?via=memory&fault=replug:3s") as lidar:
        streams = [lidar.scans() for _ in range(3)]
        for stream in streams:
            await anext(stream)
        connected = [lidar.is_connected]
        await asyncio.gather(*(end_of(stream, DeviceLost, "unplugged") for stream in streams))
        assert [*connected, lidar.is_connected] == [True, False]
        with pytest.raises(DeviceLost, match="unplugged") as caught:
            await lidar.get_health()
        assert str(caught.value.__cause__) != str(caught.value), "one sentence stands twice in the traceback"
        await asyncio.sleep(1.0)
    (told,) = caplog.messages
    assert told.startswith("the session ended: ")
    assert "unplugged" in told


@pytest.mark.parametrize("how", ["leaves", "stops", "closes"])
async def test_a_mistake_of_lidario_at_the_end_of_a_stream_leaves_the_device_still_all_the_same(
    rig: Rig, how: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """What waits is judged when a stream ends, and the stop requests come behind that."""

    def fails(_: Assembler) -> list[Scan]:
        raise IndexError("a bug")

    lidar = await rig.open()
    async with scanning(lidar):
        monkeypatch.setattr(Assembler, "end", fails)
        if how == "stops":
            await lidar.stop()
        elif how == "closes":
            await lidar.close()
    if how == "leaves":
        await asyncio.sleep(1.0)
    assert left_still(rig)
    await lidar.close()
    assert "lidario failed when a stream ended" in caplog.text
    caplog.clear()


async def test_a_mistake_of_ours_ends_the_stream_and_says_so(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def blunder(*_: object) -> list[Scan]:
        raise IndexError("a bug")

    async with rig.read() as (_, stream):
        monkeypatch.setattr(Seam, "splits", blunder)
        error = await end_of(stream, InternalError, r"IndexError\('a bug'\).*report")
        assert isinstance(error.__cause__, IndexError)
        await asyncio.sleep(0.5)
        assert left_still(rig)


async def test_a_device_that_does_not_come_back_from_a_reset(rig: Rig) -> None:
    async with rig.open() as lidar:
        async with scanning(lidar) as stream:
            rig.device.boot_s = 600.0
            with pytest.raises(ResponseTimeout, match="no response to"):
                await lidar.reset()
            await end_of(stream, why="could not be started again")
        assert not lidar.is_scanning


async def test_bytes_that_a_full_port_dropped_are_told(rig: Rig) -> None:
    with cable_to(rig) as cable:
        lidar = await rig.open()
    async with lidar, scanning(lidar) as stream:
        before = lidar.stats
        assert before.discarded_bytes == 0
        late = cable.ports[-1].late
        late.overflow_bytes = 5000
        await anext(stream)
        late.overflow_bytes = 5100
        await anext(stream)
        after = lidar.stats
    assert after.discarded_bytes == 5100
    ordinary = 3 * (before.bytes_received // max(before.scans, 1))
    assert 5100 < after.bytes_received - before.bytes_received < 5100 + ordinary
