"""When each beam of a LaserScan says that it was measured, against streams of devices.

Two ways: the golden streams, whose samples are numbered; and simulated devices in a world whose distances are the
time.
"""

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import pytest

from lidario.laserscan import LaserScan
from lidario.scan import Scan
from lidario.sim.faults import Faults
from lidario.sim.world import World
from tests.reference.samples import Sample
from tests.support.cases import EVEN, Case, most_or_all
from tests.support.devices import FAMILIES, make_rig, scanning
from tests.support.kept import arrivals
from tests.support.loop import driven
from tests.support.streams import assembled
from tests.support.sweep import EVERY_MS

# ------------------------------------------------------------------------------------------- times, golden streams


def without(case: Case, every: int) -> Iterator[tuple[Scan, list[tuple[int, Sample]]]]:
    """Each scan of a stream without every so many-th packet, and its samples, numbered as in the whole one.

    The last packets, which end a turn, are there.
    """
    last = len(case.packets) - 2
    left = [n for n in range(len(case.packets)) if every == 0 or n % every != every // 2 or n >= last]
    scans = assembled(case, b"".join(case.packets[n] for n in left), times=arrivals(case, left)).scans
    there = set(left)
    number = {(sample.packet, sample.index): n for n, sample in enumerate(case.samples)}
    for made, turn in zip(scans, case.turns, strict=True):
        yield made, [(number[each.packet, each.index], each) for each in turn if each.packet in there]


@pytest.mark.exhaustive("every", sample=[9], full=[0, 9, 40])
@most_or_all(EVEN)
def test_golden_samples_meet_the_times_of_their_beams(case: Case, every: int) -> None:
    """Also those around lost packets, of which every so many-th is one."""
    checked = 0
    for made, turn in without(case, every):
        first = turn[0][0]
        laser = made.to_laserscan(720)
        period_ns = laser.scan_time * 1e9
        corrections = [(sample.angle_deg - sample.raw_deg + 180) % 360 - 180 for _, sample in turn]
        usual, fitted = float(np.median(corrections)), float(np.ptp(corrections)) > 0.01
        for (number, sample), correction in zip(turn, corrections, strict=True):
            since = (number - first) * case.sample_us * 1e3
            way = (math.radians(-sample.angle_deg) - laser.angle_min) / laser.angle_increment + 0.5
            beam = math.floor(way) % 720
            if min(way % 720, -way % 720) < 720 / 360 / 64:
                continue  # on the end of the grid, within the rounding of angles: the angle does not tell which end
            margin = 10 + 2 * abs(correction - usual)
            if fitted and not margin < beam < 720 - margin:
                continue  # at an end of the grid, which is fitted to corrected angles: perhaps beyond that end
            when = laser.stamp_ns - made.wall_stamp_ns + beam * laser.time_increment * 1e9
            # A sample whose angle is corrected unlike the others' stands beside those measured before or after.
            unlike = abs(correction - usual) / 360 * period_ns
            assert abs(when - since) <= period_ns / 720 + EVERY_MS + unlike
            checked += 1
    assert checked > 500


@pytest.mark.exhaustive("every", sample=[9], full=[9, 40])
@most_or_all(EVEN)
def test_samples_around_lost_packets_have_their_own_times(case: Case, every: int) -> None:
    """Within a sample, whatever corrections have moved their angles by."""
    scans = list(without(case, every))
    assert sum(made.lost_packets for made, _ in scans) > 1
    for made, turn in scans:
        since = np.array([number for number, _ in turn])
        off_ns = made.times_ns - made.stamp_ns - (since - since[0]) * case.sample_us * 1e3
        assert np.abs(off_ns).max() <= case.sample_us * 1e3


# --------------------------------------------------------------------------------------- times, simulated devices


class ClockWorld(World):
    """Every distance is the time of its measuring: 1 m, and 10 mm more each millisecond for two seconds."""

    def __init__(self) -> None:
        super().__init__(np.zeros(1 << 15))

    def ranges_mm(self, angles_deg_clockwise: npt.ArrayLike, t_seconds: npt.ArrayLike) -> npt.NDArray[np.float64]:
        times = np.broadcast_to(np.asarray(t_seconds, np.float64), np.shape(np.atleast_1d(angles_deg_clockwise)))
        mm: npt.NDArray[np.float64] = 1000.0 + times * 1e3 % 2000.0 * 10.0
        return mm


def off_ms(laser: LaserScan, made: Scan) -> list[float]:
    """How far each beam with a return is from the time that its distance says, in milliseconds.

    Counted from the first sample of the scan: its stamp, which is estimated from arrivals, is tested elsewhere.
    """
    first_m = float(made.ranges[0])
    found = []
    for i, metres in enumerate(laser.ranges.tolist()):
        if math.isfinite(metres):
            when = (laser.stamp_ns - made.wall_stamp_ns) * 1e-6 + i * laser.time_increment * 1e3
            found.append((when - (metres - first_m) * 100.0 + 1000.0) % 2000.0 - 1000.0)
    return found


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES)
@driven
async def test_beams_say_when_they_were_measured_although_packets_are_lost(family: str) -> None:
    rig = make_rig(family, world=ClockWorld())
    damage, send = Faults(flip=4e-4, seed=1), rig.device.transmit
    async with rig.open() as lidar, scanning(lidar, depth=20) as stream:
        rig.device.transmit = lambda now: damage.apply(send(now), now)
        scans = [await anext(stream) for _ in range(12)]
        rig.device.transmit = send
    assert sum(made.lost_packets for made in scans) > 20
    for made in scans:
        laser = made.to_laserscan(720)
        assert laser.scan_time == pytest.approx(rig.turn_s, rel=0.005)
        off = off_ms(laser, made)
        assert len(off) > 200
        assert max(map(abs, off)) <= 1.0 + 1e3 * rig.turn_s / 720
        assert laser.range_max == 30.0
