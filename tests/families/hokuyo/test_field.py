"""A field of 240 or 270 degrees, from session to message: nothing is said of what the device does not see."""

import math
from pathlib import Path

import numpy as np
import pytest

import lidario
from lidario import LaserScan, Scan
from lidario.families.base import Known
from lidario.families.hokuyo.device import find_stream
from lidario.families.hokuyo.simulated import pack_block, pack_lines
from lidario.scans.beams import BeamOptions, resample
from lidario.scans.rotor import Rotor
from lidario.testing import make_scan
from tests.families.hokuyo.about import CASES, GEOMETRY
from tests.support.devices import Rig, make_rig, some, take
from tests.support.loop import run_driven
from tests.support.recorded import assert_same_scans, record, take_scans
from tests.support.streams import in_one_run

FIELDS = {"hokuyo-urg04lx": (-340, 341, 1024), "hokuyo-ust10lx": (-540, 540, 1440)}
"""First and last step, counted from ahead, and steps of 360 degrees."""
REACH_M = {"hokuyo-urg04lx": 5.6, "hokuyo-ust10lx": 30.0}
TURN_NS = {"hokuyo-urg04lx": 100e6, "hokuyo-ust10lx": 25e6}
"""As the devices tell it (DMAX, SCAN)."""
every_field = pytest.mark.parametrize("model", FIELDS)


async def scans_of(model: str) -> list[Scan]:
    async with make_rig(model).open() as lidar:
        return await take(lidar, 4)


@every_field
async def test_the_message_covers_the_field_and_no_more(model: str) -> None:
    first, last, turn = FIELDS[model]
    for scan in await scans_of(model):
        message = scan.to_laserscan()
        assert scan.max_range == message.range_max == REACH_M[model]
        assert message.angle_min == pytest.approx(first * math.tau / turn)
        assert message.angle_max == pytest.approx(last * math.tau / turn)
        assert message.angle_increment == pytest.approx(math.tau / turn)
        assert len(message.ranges) == len(scan) == last - first + 1
        assert scan.time_increment_ns == round(TURN_NS[model] / turn)
        # Each beam is a sample, in the order of measuring: that of the angles.
        np.testing.assert_array_equal(message.ranges, np.where(scan.valid, scan.ranges, np.inf).astype(np.float32))
        assert message.time_increment == pytest.approx(scan.time_increment_ns * 1e-9, rel=1e-4)
        assert message.stamp_ns == pytest.approx(scan.wall_stamp_ns, abs=2)
        assert message.scan_time == pytest.approx(60 / scan.rpm, rel=0.03)
        for order in ("measured", "counter-clockwise"):
            assert scan.to_laserscan(order=order).time_increment > 0


@every_field
async def test_a_grid_of_any_size_has_the_times_and_angles_of_its_samples(model: str) -> None:
    scan = (await scans_of(model))[-1]
    for beams in (90, 683, 2000):
        message = scan.to_laserscan(beams, no_return="zero", mount_yaw=0.3)
        angles = message.angle_min + np.arange(beams) * message.angle_increment
        times = message.stamp_ns + np.arange(beams) * message.time_increment * 1e9
        for number in np.flatnonzero(message.ranges > 0)[::7]:
            near = np.argmin(np.abs(scan.ranges - message.ranges[number]))
            away = (scan.angles[near] + 0.3 - angles[number] + math.pi) % math.tau - math.pi
            if (
                scan.ranges[near] == message.ranges[number]
                and np.count_nonzero(scan.ranges == scan.ranges[near]) == 1
            ):
                assert abs(away) <= message.angle_increment
                late_ns = times[number] - (scan.wall_stamp_ns + scan.times_ns[near] - scan.stamp_ns)
                assert abs(late_ns) <= 1e9 * message.time_increment + scan.time_increment_ns


@every_field
async def test_a_selection_and_a_sorted_scan_keep_the_field(model: str) -> None:
    scan = (await scans_of(model))[-1]
    whole, front = scan.to_laserscan(500), scan.select(between=(-0.5, 0.5)).to_laserscan(500)
    assert (front.angle_min, front.angle_max, front.time_increment) == (
        whole.angle_min,
        whole.angle_max,
        whole.time_increment,
    )
    assert abs(front.stamp_ns - whole.stamp_ns) <= 2
    angles = whole.angle_min + np.arange(500) * whole.angle_increment
    assert np.isnan(front.ranges[np.abs(angles) > 0.52]).all()
    np.testing.assert_array_equal(front.ranges[np.abs(angles) < 0.48], whole.ranges[np.abs(angles) < 0.48])
    assert scan.sorted().to_laserscan().to_cdr() == scan.to_laserscan().to_cdr()
    again = LaserScan.from_cdr(whole.to_cdr())
    assert again is not None
    assert again.angle_min == pytest.approx(whole.angle_min)


@every_field
async def test_nothing_is_said_of_what_lies_behind(model: str) -> None:
    scan = (await scans_of(model))[-1]
    assert scan.nearest(between=(2.7, -2.7)) is None
    assert scan.at(math.pi) is None
    ahead = scan.nearest(between=(-0.3, 0.3))
    assert ahead is not None
    assert ahead.range == pytest.approx(np.nanmin(scan.ranges[np.abs(scan.angles) <= 0.3]))
    assert len(scan.points()) == int(scan.valid.sum())
    assert (scan.lost_packets, scan.dropped_before) == (0, 0)


def test_a_field_that_is_turned_clockwise_falls_in_time() -> None:
    """No device of today does so."""
    degrees = np.arange(45.5, 225.5)
    scan = make_scan(-np.radians(degrees), degrees / 100, wall_stamp_ns=0)
    message = resample(scan, Rotor(45.0, 0.0, 100e6, 180.0), BeamOptions())
    assert math.degrees(message.angle_min) % 360 == pytest.approx(360 - 224.5)
    assert message.time_increment == pytest.approx(-100e-3 / 360)
    np.testing.assert_allclose(message.ranges, degrees[::-1] / 100, rtol=1e-6)
    assert message.stamp_ns == pytest.approx(100e6 * 179.5 / 360, abs=1)


@pytest.mark.parametrize("rig", ["hokuyo"], indirect=True)
async def test_sectors_come_with_the_scan_and_beside_the_field_they_are_empty(rig: Rig) -> None:
    async with rig.open() as lidar, lidar.sectors(45.0) as stream:
        found = await some(stream, 24)
    numbers = [(sector.seq, sector.index) for sector in found]
    begin = numbers[0][0]
    assert numbers == [(begin + number // 8, number % 8) for number in range(24)]
    assert [len(sector) > 0 for sector in found[8:16]] == [True] * 6 + [False] * 2
    assert sum(map(len, found[8:16])) == 682


def test_a_recording_has_what_its_packets_do_not_tell(tmp_path: Path) -> None:
    live = record(
        tmp_path / "run.mcap",
        "sim://hokuyo-ust10lx",
        act=lambda lidar, live: take_scans(lidar, live, 8, "Intensity"),
    )
    for again in (list(lidario.decode_file(live.path)), run_driven(lambda: _played(live.path, len(live.scans)))):
        assert_same_scans(live.scans, again)
        for one, other in zip(live.scans, again, strict=False):
            assert other.intensities is not None
            assert one.field_of_view == other.field_of_view
            np.testing.assert_array_equal(one.to_laserscan().ranges, other.to_laserscan().ranges)


async def _played(path: Path, count: int) -> list[Scan]:
    async with lidario.open_lidar(f"{path}?rate=1") as lidar:
        assert lidar.info.model == "Hokuyo UST-10LX"
        return await take(lidar, count)


@pytest.mark.parametrize("counts", [False, True])
def test_what_tells_the_field_tells_whether_the_model_is_a_guess(counts: bool) -> None:
    raw = CASES[0].raw
    guessed = find_stream(memoryview(raw), Known())
    assert guessed is not None
    assert (guessed.title, guessed.stream.mode.details) == ("Hokuyo URG-04LX", GEOMETRY.text)
    assert "taken for a URG-04LX, by its first and last step" in guessed.guess
    told = GEOMETRY._replace(front=300, farthest=4000)
    response = pack_lines(b"PP", told.text.split(";"), counts_semicolon=counts)
    found = find_stream(memoryview(response + raw), Known())
    assert found is not None
    assert (found.title, found.guess, found.begin) == ("", "", len(response))
    assert found.stream.mode.details == told.text


def test_a_block_of_a_ust_is_known_by_its_steps() -> None:
    block = pack_block(b"MD0000108001000", 0, np.full(1081, 1000))
    found = find_stream(memoryview(block), Known())
    assert found is not None
    assert found.title == "Hokuyo UST-10LX, UST-20LX or UTM-30LX"
    wire = found.stream.format
    assert wire.field_deg == pytest.approx(-270, abs=1)
    assert wire.begin_deg == pytest.approx(-wire.field_deg / 2)


def test_of_a_block_whose_device_is_not_known_it_sees_from_20_mm_on() -> None:
    """DMIN of an URG-04LX and a UST-10LX; below are codes of errors."""
    for field in (b"00440725", b"00001080"):
        steps = int(field[4:]) - int(field[:4]) + 1
        block = pack_block(b"MD%s01000" % field, 0, np.resize([19, 20], steps))
        found = find_stream(memoryview(block), Known())
        assert found is not None
        wire = found.stream.format
        decoded = found.stream.decoder.decode(in_one_run(wire, block), None)
        assert set(decoded.distance_mm[0::2]) == {0}
        assert set(decoded.distance_mm[1::2]) == {20}


def test_the_speed_is_what_the_device_tells() -> None:
    async def main() -> tuple[float, float]:
        async with lidario.open_lidar("sim://hokuyo-urg04lx?via=memory") as lidar:
            rate = await lidar.get_sample_rate()
            return await lidar.get_scan_frequency(), rate.standard_us

    # 600 revolutions a minute, 1024 steps each.
    assert run_driven(main) == pytest.approx((10.0, 1e6 / 10 / 1024))
