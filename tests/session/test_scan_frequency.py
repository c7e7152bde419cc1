"""The scan frequency: set, asked for and measured."""

import asyncio
import math

import pytest

from lidario import InvalidValue, RemoteProtocolError, ResponseTimeout, Scan, ScanStream
from tests.support.devices import FAMILIES, Rig, left_still, some
from tests.support.times import takes


@pytest.mark.parametrize("rig", [*FAMILIES, "rplidar-c1"], indirect=True)
async def test_the_set_speed_is_checked_against_the_measured_one(rig: Rig) -> None:
    async with rig.read() as (lidar, stream):
        assert await lidar.set_scan_frequency(9.0) == pytest.approx(9.0, abs=0.05)
        assert lidar.measured_scan_frequency == pytest.approx(9.0, rel=0.05)
        assert await lidar.set_motor_speed(600) == pytest.approx(600, abs=3)
        scan = await anext(stream)
        assert scan.rpm == pytest.approx(600, rel=0.05)
        told = 600.0 if rig.family == "ydlidar" else math.nan
        assert [scan.reported_rpm, scan.sorted().reported_rpm] == pytest.approx([told] * 2, abs=3, nan_ok=True)
        slowest, fastest = await lidar.get_scan_frequency_range()
        assert 5.0 <= slowest < fastest <= 20.0
        for wrong, rpm in ((40, 2400), (0.1, 6)):
            says = rf"^{wrong} Hz is outside of the 4ROS's 5 to 12 Hz$"
            if rig.family == "rplidar":
                rpms = rf"\({60 * slowest:g} to {60 * fastest:g} rpm\)"
                says = rf"^{wrong} Hz \({rpm} rpm\) .* {slowest:g} to {fastest:g} Hz {rpms}$"
            with pytest.raises(InvalidValue, match=says):
                await lidar.set_scan_frequency(wrong)
        for wrong in (float("nan"), float("inf")):
            with pytest.raises(InvalidValue, match="finite"):
                await lidar.set_scan_frequency(wrong)
        assert (await anext(stream)).rpm == pytest.approx(600, rel=0.05)


async def test_it_is_measured_exactly(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.session.questions.SPEED_TOLERANCE", 0.003)
    async with rig.read() as (lidar, _):
        assert await lidar.set_scan_frequency(9.0) == pytest.approx(9.0, abs=0.05)


@pytest.mark.long
async def test_a_rotor_not_at_its_speed_within_10_s_is_told(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.session.questions.SPEED_TOLERANCE", -1.0)
    async with rig.read() as (lidar, _):
        says = r"^9\S+ Hz is set, but the rotor turns at 9\S+ Hz after 10 s"
        with takes(12.0), pytest.raises(RemoteProtocolError, match=says):
            await lidar.set_scan_frequency(9.0)


async def test_where_no_stream_begins_that_is_the_error(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was told as a rotor that turns at nan Hz."""

    class NotBegun(ScanStream):
        async def __anext__(self) -> Scan:
            raise ResponseTimeout("SCAN", 2.0)

    monkeypatch.setattr("lidario.session.questions.ScanStream", NotBegun)
    async with rig.read() as (lidar, _):
        with pytest.raises(ResponseTimeout, match="SCAN"):
            await lidar.set_scan_frequency(9.0)


async def test_a_speed_behind_which_another_task_sets_one_is_not_waited_for(rig: Rig) -> None:
    async with rig.read() as (lidar, _):
        with takes(8.0):
            told = await asyncio.gather(*(lidar.set_scan_frequency(each) for each in (8.0, 9.0, 11.0)))
        assert told == [pytest.approx(each, abs=0.05) for each in (8.0, 9.0, 11.0)]
        assert lidar.measured_scan_frequency == pytest.approx(11.0, rel=0.05)


async def test_a_speed_that_is_set_beside_a_question_for_it_stays_set(rplidar: Rig) -> None:
    async with rplidar.open() as lidar:
        await asyncio.gather(lidar.set_scan_frequency(9.0, verify=False), lidar.get_scan_frequency())
        assert await lidar.get_scan_frequency() == 9.0
        await lidar.scan()
        assert rplidar.device.motor.target_rpm == 540


@pytest.mark.long
@pytest.mark.parametrize("mode", ["Standard", "DenseBoost"])
async def test_a_speed_set_in_mid_scan_is_one_request_and_interrupts_nothing(rplidar: Rig, mode: str) -> None:
    async with rplidar.open() as lidar, lidar.scans(mode, depth=256) as stream:
        scans = [await anext(stream)]
        for hertz in (15.0, 8.0):
            asked = len(rplidar.device.log)
            assert await lidar.set_scan_frequency(hertz) == hertz
            assert [entry.name for entry in rplidar.device.log[asked:]] == ["motor_speed_ctrl"]
            assert lidar.measured_scan_frequency == pytest.approx(hertz, rel=0.05)
        # A question for it asks nothing, and two at once are two requests, each in its own time.
        await asyncio.gather(*(lidar.set_scan_frequency(each, verify=False) for each in (9.0, 10.0)))
        assert await lidar.get_scan_frequency() == 10.0
        await asyncio.sleep(1.0)
        assert rplidar.device.motor.target_rpm == pytest.approx(600)
        scans += await some(stream, 20)
        assert [scan.seq for scan in scans] == list(range(21))
        stats = lidar.stats
        assert (stats.interruptions, stats.lost_packets, stats.missed_scans, stats.broken_scans) == (0, 0, 0, 0)


@pytest.mark.parametrize("yields", range(12))
async def test_a_speed_beside_a_stop_leaves_the_rotor_at_rest(rplidar: Rig, yields: int) -> None:
    async with rplidar.read() as (lidar, _):
        # The second one waits until the device listens again.
        await lidar.set_scan_frequency(9.0, verify=False)
        setting = asyncio.ensure_future(lidar.set_scan_frequency(12.0, verify=False))
        for _ in range(yields):
            await asyncio.sleep(0.001)
        await lidar.stop()
        await asyncio.wait([setting])
        await asyncio.sleep(1.0)
        assert left_still(rplidar)


async def test_several_settings_in_a_row_wait_for_no_more_than_the_device_needs(rplidar: Rig) -> None:
    """It hears nothing for 10 ms behind each; what is written then is written again soon."""
    async with rplidar.read() as (lidar, _):
        with takes(0.05):
            for hertz in (9.0, 11.0, 10.0):
                await lidar.set_scan_frequency(hertz, verify=False)
