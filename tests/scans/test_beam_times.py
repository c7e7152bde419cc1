"""When each beam of a LaserScan says that it was measured, against scans that say which sample each one is.

They are made here, and their distances say it; or of golden streams, whose samples are numbered; or of simulated
devices in a world whose distances are the time.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lidario.scans.beams import BeamOrder
from lidario.scans.laserscan import LaserScan
from lidario.scans.rotor import follow_rotor, times_of
from lidario.scans.scan import Scan
from lidario.sim.faults import Faults
from lidario.sim.world import World
from tests.reference.samples import Sample
from tests.support.cases import EVEN, Case, most_or_all
from tests.support.devices import FAMILIES, make_rig, scanning
from tests.support.kept import arrivals
from tests.support.loop import driven
from tests.support.streams import assembled
from tests.support.sweep import EVERY_MS, ORDERS, check, sweep

SWEEPS = st.fixed_dictionaries(
    {
        "hertz": st.floats(4, 20),
        "sample_us": st.sampled_from([500.0, 1000.0]),
        "seam": st.sampled_from([0.0, 0.0, 15.3, 180.0, 355.3]),
        "declared": st.booleans(),
        "phase": st.floats(0, 0.99),
        "shift": st.floats(-0.4, 0.4),
        "gaps": st.lists(st.tuples(st.floats(0, 0.95), st.floats(0.005, 0.1)), max_size=4),
    }
)
ONE_LOST = {"hertz": 6.0, "sample_us": 1000.0, "seam": 15.3, "declared": False, "gaps": [(0.25, 0.0078125)]}
"""Exactly one sample lost, and not enough to be seen in the duration."""


@pytest.mark.long
@example(ONE_LOST, 0.0, None, 0.0, "counter-clockwise")
@example(ONE_LOST, -0.006, None, 0.0, "counter-clockwise")
@given(SWEEPS, st.floats(-0.06, 0.06), st.none() | st.integers(1, 300), st.floats(-10, 10), st.sampled_from(ORDERS))
def test_times_are_right_whatever_the_scan_is_like(
    made: dict[str, Any], miscounted: float, beams: int | None, yaw: float, order: BeamOrder
) -> None:
    truth = sweep(**made, miscounted=miscounted if made["gaps"] else 0.0)
    check(truth.scan.to_laserscan(beams, mount_yaw=yaw, order=order), truth, yaw)


def test_known_gaps_tell_the_times_also_where_the_rotor_was_braked() -> None:
    angles = np.cumsum([0.8] * 200 + [0.16] * 800)
    numbers = np.delete(np.arange(1000), range(100, 112))
    gaps = [(100, 12)]
    rotor = follow_rotor(angles[numbers], 1000, 1000 * 1000, lost_packets=1, gaps=gaps)
    np.testing.assert_array_equal(times_of(angles[numbers], 1000, rotor, gaps), numbers * 1000)


def test_the_grid_is_the_same_for_scans_that_begin_at_the_seam() -> None:
    kinds: list[dict[str, Any]] = [{}, {"phase": 0.9}, {"shift": -0.1}, {"shift": 0.3}]
    kinds += [{"gaps": [gap]} for gap in ((0.0, 0.08), (0.9, 0.1))]
    for seam in (0.0, 15.3):
        grids = [sweep(hertz=10, sample_us=500, seam=seam, **kind).scan.to_laserscan(720) for kind in kinds]
        assert [grid.angle_min for grid in grids] == pytest.approx([math.radians(0.25 - seam)] * len(kinds))


def test_a_seam_that_was_not_told_moves_the_grid() -> None:
    truth = sweep(hertz=10, sample_us=500, seam=20.0, declared=False)
    laser = truth.scan.to_laserscan(720)
    assert laser.angle_min == pytest.approx(math.radians(0.25 - 20.0), abs=1e-6)


def test_samples_that_a_user_took_out_do_not_change_the_times() -> None:
    truth = sweep(hertz=10, sample_us=500)
    angles = truth.scan.device_angles
    outside = (angles < 100) | (angles > 140)
    thinned = replace(
        truth.scan, device_angles=angles[outside], device_distances=truth.scan.device_distances[outside]
    )
    check(thinned.to_laserscan(360), replace(truth, scan=thinned))


def test_a_sorted_scan_has_the_times_of_the_one_it_was_made_from() -> None:
    truth = sweep(hertz=10, sample_us=500, gaps=[(0.0, 0.05), (0.5, 0.1)])
    for made in (truth.scan.sorted(), truth.scan.sorted().sorted()):
        check(made.to_laserscan(360), truth)
    # Sorted by somebody else, it has at least the values, and a grid from the seam.
    order = np.argsort(truth.scan.angles)
    foreign = replace(
        truth.scan,
        device_angles=truth.scan.device_angles[order],
        device_distances=truth.scan.device_distances[order],
    ).to_laserscan(360)
    usual = truth.scan.to_laserscan(360)
    np.testing.assert_array_equal(foreign.ranges, usual.ranges)
    assert foreign.angle_min == usual.angle_min


def test_figures_that_contradict_each_other_give_the_duration() -> None:
    odd = replace(sweep(hertz=10, sample_us=500).scan, time_increment_ns=7)
    assert odd.to_laserscan(360).scan_time == pytest.approx(0.1)
    assert replace(odd, time_increment_ns=0).to_laserscan(360).scan_time == pytest.approx(0.1)
    assert replace(odd, time_increment_ns=0, duration_ns=0).to_laserscan(360).time_increment == 0


def test_one_close_return_at_the_seam_does_not_move_the_times() -> None:
    """Formats that correct angles turn a close return back by up to 13 degrees."""
    truth = sweep(hertz=10, sample_us=31.25, phase=0.5)
    angles = truth.scan.device_angles.copy()
    angles[[0, 1, 2]] = 356.0
    angles[-2:] = [3.0, 3.1]
    odd = replace(truth.scan, device_angles=angles)
    rotor = follow_rotor(odd.device_angles, odd.time_increment_ns, odd.duration_ns)
    assert rotor.begin_deg == 0.0
    assert abs(rotor.begin_ns) < 0.2 * EVERY_MS
    assert rotor.period_ns == pytest.approx(100e6, rel=2e-3)
    laser = odd.to_laserscan(720, order="measured")
    # They stay at the end of the revolution at which they were measured.
    assert laser.ranges[0] == np.float32(1.0)
    assert laser.ranges[-1] == pytest.approx((1000 + len(odd) - 5) / 1000, abs=0.01)


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


@pytest.mark.exhaustive("every", sample=[9, 40], full=[0, 9, 40])
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
