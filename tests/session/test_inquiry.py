"""A stream brings no scans: the device is asked before anybody is told. On strict devices, in driven time."""

import asyncio
from collections.abc import Callable
from unittest.mock import create_autospec

import pytest

from lidario import DeviceFault, Lidar, StreamFailed
from lidario.revolution.seam import Seam
from lidario.session.streaming.failures import Failures
from tests.support.cable import next_after
from tests.support.devices import Rig, end_of, make_rig, names, scanning, some
from tests.support.loop import driven_loop, now, now_ns
from tests.support.times import cancelled, takes

CODE = 0x8001
OF_EACH_BOOT = ("rplidar-s2", "rplidar-s1", "rplidar-old-firmware", "ydlidar-4ros")
"""The second one is silent for two seconds, and the third one prints a banner."""
RECOVERED_S = 3.5
"""Silence of 0.6 s, the questions, a boot of 1 s, and the first revolution, which is a partial one."""


def fall_silent(rig: Rig) -> None:
    """The stream ends by itself, and the device is well."""
    rig.device.halt(now_ns())


async def error_of(
    lidar: Lidar, harm: Callable[[], object], kind: type[Exception] = StreamFailed
) -> tuple[str, float]:
    """What a stream ends with after `harm`, and after how long."""
    async with scanning(lidar) as stream:
        began = now()
        harm()
        return str(await end_of(stream, kind)), now() - began


async def test_a_protection_stop_in_mid_scan_is_cured_and_told(rig: Rig, caplog: pytest.LogCaptureFixture) -> None:
    async with rig.open() as lidar:
        await lidar.set_scan_frequency(9.0)
        async with scanning(lidar) as stream:
            rig.device.protection_stop(CODE)
            with takes(RECOVERED_S):
                scans = await some(stream, 4)
        assert (lidar.stats.protection_stops, lidar.stats.restarts) == (1, 1)
        assert lidar.health.ok
        assert "0x8001" in lidar.health.note
        assert any("0x8001" in record.message for record in caplog.records)
        assert any("started again" in record.message for record in caplog.records)
        assert scans[-1].rpm == pytest.approx(540, rel=0.01)
    assert names(rig).count("reset") == 1


async def test_a_program_that_asks_first_is_told_and_the_stream_goes_on(rig: Rig) -> None:
    async with rig.read() as (lidar, stream):
        rig.device.protection_stop(CODE)
        with takes(RECOVERED_S):
            began = now()
            assert (await lidar.get_health()).code == CODE
            await next_after(stream, began + 0.5)
        assert lidar.stats.protection_stops == 1


@pytest.mark.long
async def test_a_second_protection_stop_within_a_minute_is_raised(rig: Rig) -> None:
    async with rig.open() as lidar:
        async with scanning(lidar) as stream:
            rig.device.protection_stop(CODE)
            await some(stream, 20)
            rig.device.protection_stop(CODE)
            error = await end_of(stream, DeviceFault, r"0x8001.*again within 60 s")
        assert error.health.code == CODE
        assert lidar.health.code == CODE
        assert lidar.stats.protection_stops == 2
        assert names(rig).count("reset") == 1
        # The session goes on, and a start that the program asks for is worth another reset.
        assert await lidar.scan()
        assert lidar.stats.protection_stops == 3


async def test_a_fault_that_stays_ends_the_stream_with_its_code_and_the_next_start_at_once(rig: Rig) -> None:
    """The next opening, too."""
    rig.device.faults_cleared_by_reset = False
    async with rig.open() as lidar:
        text, after = await error_of(lidar, lambda: rig.device.protection_stop(CODE), DeviceFault)
        assert "0x8001" in text
        assert after < 2.5
        with takes(2.5), pytest.raises(DeviceFault, match="0x8001"):
            await lidar.scan()
        rig.device.faults_cleared_by_reset = True
        assert await lidar.scan()
    rig.device.faults_cleared_by_reset = False
    rig.device.protection_stop(0x21)
    with pytest.raises(DeviceFault, match="33") as caught:
        await rig.open()
    assert caught.value.health.code == 0x21


@pytest.mark.discards("a device in Protection Stop starts no stream, and does not say so")
async def test_a_protection_stop_while_nothing_runs_is_cured_by_the_next_start(rig: Rig) -> None:
    async with rig.open() as lidar:
        await lidar.scan()
        await lidar.stop()
        rig.device.protection_stop(CODE)
        assert await lidar.scan()
        assert lidar.stats.protection_stops == 1


async def test_after_a_rest_the_device_is_asked_before_it_is_started(rig: Rig) -> None:
    """As the vendors' manuals have it. It discards no request, and nobody waits for a stream that cannot begin."""
    async with rig.open() as lidar:
        await lidar.scan()
        await lidar.stop()
        asked = len(names(rig))
        await asyncio.sleep(4.8)
        await lidar.scan()
        assert "get_health" not in names(rig)[asked:]
        await lidar.stop()
        await asyncio.sleep(5.1)
        asked = len(names(rig))
        rig.device.protection_stop(CODE)
        with takes(rig.device.boot_s + rig.device.spin_up_s + 1.5):
            assert await lidar.scan()
        assert names(rig)[asked:].index("get_health") < names(rig)[asked:].index("reset")


@pytest.mark.parametrize("rig", OF_EACH_BOOT, indirect=True)
async def test_a_protection_stop_at_open_is_cured_and_told(rig: Rig, caplog: pytest.LogCaptureFixture) -> None:
    rig.device.protection_stop(CODE)
    async with rig.open() as lidar:
        assert lidar.health.ok
        assert "0x8001" in lidar.health.note
        assert lidar.stats.protection_stops == 1
        assert await lidar.scan()
    assert "reset" in names(rig, obeyed=True)
    assert [record.message for record in caplog.records if "0x8001" in record.message]


@pytest.mark.long
async def test_a_well_device_that_falls_silent_is_restarted(rig: Rig, caplog: pytest.LogCaptureFixture) -> None:
    async with rig.open() as lidar:
        async with lidar.scans() as stream:
            for count in (1, 2, 3):
                await anext(stream)
                fall_silent(rig)
                with takes(1.5):
                    await some(stream, 3)
                assert (lidar.stats.restarts, lidar.stats.protection_stops) == (count, 0)
            assert "no scan data for 0.6 s" in caplog.text
            fall_silent(rig)
            await end_of(stream, why="fourth time within 60 s, though it responds and its health is ok")
        assert await lidar.scan()


@pytest.mark.parametrize(("protected", "pauses_s"), [(False, (6.0, 1.0, 1.0, 1.0)), (True, (6.0, 6.0))])
async def test_after_a_while_it_is_started_again(
    rig: Rig, protected: bool, pauses_s: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A well device a fourth time, where the first is long ago, and the second and the third are not."""
    monkeypatch.setattr("lidario.session.streaming.failures.PERIOD_S", 5.0)
    async with rig.open() as lidar, lidar.scans() as stream:
        for count, pause_s in enumerate(pauses_s, 1):
            await anext(stream)
            if protected:
                rig.device.protection_stop(CODE)
            else:
                fall_silent(rig)
            began = now()
            while now() - began < pause_s:
                await anext(stream)
            assert lidar.stats.restarts == count
            assert lidar.stats.protection_stops == count * protected


async def test_a_dead_device_is_told_of_within_a_second(rig: Rig) -> None:
    async with rig.open() as lidar:
        text, after = await error_of(lidar, lambda: setattr(rig.device, "mute", True))
        assert "and it says nothing at all: is it powered, and is the cable in?" in text
        assert after < 1.0
        # The session goes on.
        rig.device.mute = False
        assert await lidar.scan()


async def test_a_stalled_rotor_is_told_within_three_revolutions(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    async with rig.open() as lidar:
        text, after = await error_of(lidar, lambda: monkeypatch.setattr(Seam, "splits", lambda *_: []))
        assert "no full revolution" in text
        assert "its health is ok: is the rotor blocked?" in text
        assert after < {"rplidar": 3.3, "ydlidar": 1.9}[rig.family]
        assert lidar.stats.restarts == 0


async def test_a_blocked_rotor_that_stopped_the_device_is_told_by_its_code(rig: Rig) -> None:
    """A device that never brings a packet is asked too."""
    rig.device.faults_cleared_by_reset = False
    async with rig.open() as lidar:
        await lidar.get_modes()
        rig.device.spin_up_s = 2.0
        scan = asyncio.create_task(lidar.scan())
        await asyncio.sleep(1.0)
        rig.device.protection_stop(CODE)
        with pytest.raises(DeviceFault, match="0x8001"):
            await scan


@pytest.mark.parametrize("harm", ["half a packet", "a bad byte long ago", "a burst that is over"])
async def test_noise_is_told_only_where_noise_is_what_arrives(rig: Rig, harm: str) -> None:
    clean = rig.device.transmit

    def spoil() -> None:
        if harm == "a burst that is over":
            rig.device.transmit = lambda now: bytes(len(clean(now)))
            asyncio.get_running_loop().call_later(0.2, end)
        elif harm == "half a packet":
            rig.device.transmit = lambda now: clean(now)[:50]
            asyncio.get_running_loop().call_later(0.002, end)
        else:
            end()

    def end() -> None:
        rig.device.transmit = clean
        rig.device.mute = True

    async with rig.open() as lidar:
        if harm == "a bad byte long ago":
            async with scanning(lidar) as stream:
                rig.device.transmit = lambda now: clean(now).replace(b"\xaa\x55", b"\xaa\x54", 1)[:-1]
                await asyncio.sleep(0.05)
                rig.device.transmit = clean
                await anext(stream)
            assert lidar.stats.skipped_bytes
        text, _ = await error_of(lidar, spoil)
        assert "noise" not in text
        assert "is it powered" in text
        rig.device.mute = False


@pytest.mark.parametrize("model", ["rplidar-a1", "rplidar-a2"])
@pytest.mark.exhaustive("boot_s", sample=[0.43, 0.5, 0.59], full=[at / 100 for at in range(40, 70)])
async def test_what_a_device_prints_when_it_has_booted_is_no_noise(model: str, boot_s: float) -> None:
    """It is silent until then. An A1 boots in 0.67 s, so that its text comes as the silence is judged."""
    rig = make_rig(model)
    rig.device.boot_s = boot_s
    async with rig.read() as (lidar, stream):
        rig.device.reboot(now_ns())
        await next_after(stream, now())
        assert lidar.stats.restarts == 1


@pytest.mark.exhaustive("act", sample=["stop", "close", "leave", "ask", "cancel", "join"])
@pytest.mark.parametrize("harm", ["silent", "protect"])
@pytest.mark.exhaustive("step", sample=[5], full=[1, 2, 3, 5, 8, 13, 21, 40])
async def test_whatever_is_done_while_the_device_is_asked(
    rig: Rig, harm: str, act: str, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At a step of the loop after the silence was noticed, another task stops, closes, leaves, asks or joins."""
    noticed = create_autospec(Failures.suspect, side_effect=Failures.suspect)
    monkeypatch.setattr(Failures, "suspect", noticed)
    loop = driven_loop()
    async with rig.read() as (lidar, stream):
        if harm == "protect":
            rig.device.protection_stop(CODE)
        else:
            fall_silent(rig)
        while not noticed.called:
            await asyncio.sleep(0.001)
        for _ in range(step):
            await asyncio.sleep(0)
            if loop.is_idle:
                await asyncio.sleep(0.004)
        if act == "stop":
            await lidar.stop()
            await end_of(stream, StopAsyncIteration)
        elif act == "close":
            await lidar.close()
        elif act == "leave":
            await stream.aclose()
        elif act == "ask":
            await lidar.get_info()
        elif act == "cancel":
            await cancelled(anext(stream))
        else:
            async with lidar.scans() as other:
                await anext(other)
        if act in ("ask", "cancel", "join"):
            await anext(stream)
            assert (await anext(stream)).seq > 0
        if act == "stop":
            assert await lidar.scan()
