"""Resampling onto the grid of a LaserScan: what each beam says, and when it says it was measured.

The times are checked three ways: against scans made here, whose distances say which sample each one is; against
the golden streams, whose samples are numbered; and on simulated devices in a world whose distances are the time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lidario.laserscan import BeamOrder, LaserScan, follow_rotor
from lidario.scan import Scan
from lidario.sim.faults import Faults
from lidario.sim.world import World
from tests.support.cases import CASES, Case, most_or_all
from tests.support.devices import FAMILIES, make_rig, take
from tests.support.kept import arrivals
from tests.support.loop import driven
from tests.support.streams import assembled
from tests.test_model import FOUR, scan

ORDERS: tuple[BeamOrder, ...] = ("counter-clockwise", "measured")
EVERY_MS = 1e6
WALL = 10**18


def at(laser: LaserScan, degrees: float) -> float:
    """The range of the beam whose share of the circle contains an angle, or what is just clockwise of it."""
    place = math.floor((math.radians(degrees - 1e-3) - laser.angle_min) / laser.angle_increment + 0.5)
    return float(laser.ranges[place % len(laser.ranges)])


def apart(one: float, other: float) -> float:
    """Degrees between two directions."""
    return abs((one - other + 180) % 360 - 180)


# ------------------------------------------------------------------------------------------------------- values


def test_the_grid() -> None:
    laser = FOUR.to_laserscan(360)
    assert len(laser.ranges) == 360
    assert laser.ranges.dtype == np.float32
    assert laser.angle_min == pytest.approx(math.radians(0.5))
    assert laser.angle_increment == pytest.approx(math.radians(1))
    assert laser.angle_max == pytest.approx(math.radians(359.5))
    assert laser.scan_time == pytest.approx(0.1)
    assert laser.time_increment == pytest.approx(-0.1 / 360)
    assert laser.frame_id == "laser"
    # The first beam was measured last, half a beam before the end of the revolution.
    assert laser.stamp_ns == WALL + 5 + round(0.1e9 * 359.5 / 360)
    assert [at(laser, each) for each in (0, -90, 180, 90)] == [1.0, 2.0, math.inf, 4.0]
    # Where nothing was measured, nothing is known.
    assert np.isnan(laser.ranges).sum() == 356
    assert len(FOUR.to_laserscan().ranges) == 4


def test_the_order_of_measuring_is_the_same_grid_backwards() -> None:
    made = sweep(hertz=10, sample_us=500, gaps=[(0.3, 0.1)])
    made_scan = replace(made.scan, intensities=np.arange(len(made.scan)).astype(np.uint8))
    usual, measured = (made_scan.to_laserscan(360, order=order, mount_yaw=0.3) for order in ORDERS)
    np.testing.assert_array_equal(measured.ranges, usual.ranges[::-1])
    np.testing.assert_array_equal(measured.intensities, usual.intensities[::-1])
    assert (measured.angle_min, measured.angle_max) == (usual.angle_max, usual.angle_min)
    assert measured.angle_increment == -usual.angle_increment < 0
    assert measured.time_increment == -usual.time_increment > 0
    last_ns = usual.stamp_ns + 359 * usual.time_increment * 1e9
    assert measured.stamp_ns == pytest.approx(last_ns, abs=1000)
    for laser in (usual, measured):
        assert laser.ranges.flags.c_contiguous
        assert laser.angle_max == pytest.approx(laser.angle_min + 359 * laser.angle_increment)


@pytest.mark.parametrize(("word", "value"), [("inf", math.inf), ("nan", math.nan), ("zero", 0.0)])
def test_a_beam_without_a_return(word: Any, value: float) -> None:
    assert at(FOUR.to_laserscan(360, no_return=word), 180) == pytest.approx(value, nan_ok=True)


def test_the_nearest_return_wins_in_a_beam() -> None:
    near = scan([50.5, 10.7, 10.5, 10.4, 10.2], [7, 2, 0, 1.5, 3], [5, 4, 3, 2, 1])
    laser = near.to_laserscan(360)
    assert at(laser, 10.5) == 1.5
    place = int(np.flatnonzero(laser.ranges == np.float32(1.5))[0])
    assert laser.intensities[place] == 2
    assert laser.intensities.dtype == np.float32
    assert laser.intensities.sum() == 2 + 5
    # A return wins over none, in either order.
    assert at(scan([10.6, 10.4], [0, 3]).to_laserscan(360), 10.5) == 3
    assert at(scan([10.6, 10.4], [3, 0]).to_laserscan(360), 10.5) == 3


def test_what_is_out_of_the_range_asked_for_did_not_return() -> None:
    far = scan([-5, -10, -20, -30, -40], [0.04, 0.05, 12, 12.1, 5])
    laser = far.to_laserscan(360, range_min=0.05, range_max=12.0)
    assert [at(laser, each) for each in (-5, -10, -20, -30, -40)] == pytest.approx(
        [math.inf, 0.05, 12, math.inf, 5]
    )
    assert (laser.range_min, laser.range_max) == (0.05, 12.0)


@pytest.mark.parametrize(("told", "stated"), [(30.0, 30.0), (0.0, 40.0), (math.nan, 40.0), (math.inf, 40.0)])
def test_the_longest_range_is_the_modes_and_describes_without_filtering(told: float, stated: float) -> None:
    laser = scan([-10, -20], [29, 31], max_range=told).to_laserscan(360)
    assert laser.range_max == stated
    assert [at(laser, -10), at(laser, -20)] == [29, 31]
    # Asked for, it is a filter.
    asked = scan([-10, -20], [29, 31], max_range=told).to_laserscan(360, range_max=30.0)
    assert asked.range_max == 30.0
    assert [at(asked, -10), at(asked, -20)] == [29, math.inf]


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, -math.pi, 7.0])
def test_the_mounting_turns_the_scan(yaw: float) -> None:
    laser = FOUR.to_laserscan(360, mount_yaw=yaw, frame_id="base")
    assert at(laser, math.degrees(yaw)) == 1.0
    assert at(laser, math.degrees(yaw) - 90) == 2.0
    assert -math.pi <= laser.angle_min < math.pi + laser.angle_increment
    assert laser.frame_id == "base"


def test_formats_without_intensity_have_none_in_ros() -> None:
    assert scan([0], [1]).to_laserscan().intensities.shape == (0,)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_scans_of_hardly_any_samples(count: int) -> None:
    laser = scan([-10.0, -20.0][:count], [1.0, 2.0][:count]).to_laserscan(72)
    assert np.isnan(laser.ranges).sum() == 72 - count
    assert laser.scan_time == pytest.approx(0.1)


def test_misuse() -> None:
    for beams in (0, -1):
        with pytest.raises(ValueError, match="at least one beam"):
            FOUR.to_laserscan(beams)
    with pytest.raises(ValueError, match="at least one beam"):
        scan([], []).to_laserscan()
    for wrong in (1.5, "9", 360.0):
        with pytest.raises(TypeError, match="beams must be a whole number"):
            FOUR.to_laserscan(wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="no_return must be one of inf, nan, zero"):
        FOUR.to_laserscan(10, no_return="none")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="order must be one of counter-clockwise, measured"):
        FOUR.to_laserscan(10, order="clockwise")  # type: ignore[arg-type]
    for yaw in (math.nan, math.inf):
        with pytest.raises(ValueError, match="mount_yaw must be finite"):
            FOUR.to_laserscan(10, mount_yaw=yaw)
    for least, most in ((-1.0, 5.0), (6.0, 5.0), (math.nan, 5.0), (0.05, math.nan)):
        with pytest.raises(ValueError, match="range_min must be between"):
            FOUR.to_laserscan(10, range_min=least, range_max=most)
    assert len(FOUR.to_laserscan(np.int64(10)).ranges) == 10


def test_samples_in_no_order_lose_nothing() -> None:
    jumbled = scan([20, -170, 90, -3, 5, 160, -80], [1, 2, 3, 4, 5, 6, 7])
    laser = jumbled.to_laserscan(36)
    assert sorted(laser.ranges[np.isfinite(laser.ranges)].tolist()) == [1, 2, 3, 4, 5, 6, 7]


# ---------------------------------------------------------------------------------------------- times, made here


@dataclass(frozen=True)
class Sweep:
    """A scan whose distances say which sample each is, and the truth about it.

    Attributes:
        scan: The scan: sample `n` of the revolution has a distance of 1000 + n millimetres.
        wall_ns: Time of each sample of the revolution, the missing ones included.
        angle_deg: Device angle of each.
        period_ns: Time of a revolution.
    """

    scan: Scan
    wall_ns: list[float]
    angle_deg: list[float]
    period_ns: float

    @property
    def kept(self) -> list[int]:
        """The samples that are in the scan."""
        return [round(float(each)) - 1000 for each in self.scan.device_distances]


def sweep(
    *,
    hertz: float,
    sample_us: float,
    seam: float = 0.0,
    declared: bool = True,
    phase: float = 0.0,
    shift: float = 0.0,
    gaps: Sequence[tuple[float, float]] = (),
    miscounted: float = 0.0,
) -> Sweep:
    """A revolution of a rotor that turns evenly.

    Args:
        hertz: Its speed.
        sample_us: Time of a sample.
        seam: Device angle where it begins.
        declared: Whether the scan says so.
        phase: Part of a sample by which the first one comes after the seam.
        shift: Degrees by which all angles are read too large.
        gaps: Begin and length of what is lost, as parts of the revolution.
        miscounted: Part of the revolution that `duration_ns` has too much.
    """
    period, every = 1e9 / hertz, sample_us * 1e3
    times = [(phase + n) * every for n in range(math.ceil(period / every - phase))]
    angles = [(seam + shift + 360 * time / period) % 360 for time in times]
    lost = {n for begin, length in gaps for n, time in enumerate(times) if begin <= time / period < begin + length}
    kept = [n for n in range(len(times)) if n not in lost]
    counted = len(times) - kept[0] + round(miscounted * len(times))
    made = scan(
        [-angles[n] for n in kept],
        [(1000 + n) / 1000 for n in kept],
        stamp_ns=round(times[kept[0]]),
        wall_stamp_ns=WALL + round(times[kept[0]]),
        time_increment_ns=round(every),
        duration_ns=round(counted * every),
        lost_packets=len(gaps),
        seam=seam if declared else 0.0,
    )
    return Sweep(made, [WALL + time for time in times], angles, period)


def check(laser: LaserScan, truth: Sweep, yaw: float = 0.0) -> None:
    """Slow, from the definition: each beam's time is that of the sample nearest to it, and of the one in it.

    The nearest sample may be a lost one: the rotor was there all the same. Two samples beside a beam may be at
    different ends of the revolution, so any within a beam's step of the nearest will do.
    """
    count = len(laser.ranges)
    beam_deg, beam_ns = 360 / count, truth.period_ns / count
    allowed = beam_ns + EVERY_MS
    for i, metres in enumerate(laser.ranges.tolist()):
        when = laser.stamp_ns - WALL + i * laser.time_increment * 1e9
        device = -math.degrees(laser.angle_min + i * laser.angle_increment - yaw) % 360
        away = [apart(device, angle) for angle in truth.angle_deg]
        nearest = min(away)
        errors = [when - (truth.wall_ns[n] - WALL) for n, deg in enumerate(away) if deg <= nearest + beam_deg]
        if math.isfinite(metres):
            sample = round(metres * 1000) - 1000
            assert abs(when - (truth.wall_ns[sample] - WALL)) <= allowed
            assert away[sample] <= beam_deg / 2 + 0.51
            assert min(map(abs, errors)) <= allowed
        else:
            assert math.isnan(metres)
            # Where nothing tells the seam and its samples are lost, the revolution may begin anywhere in the gap.
            half = truth.period_ns / 2
            assert min(abs((error + half) % truth.period_ns - half) for error in errors) <= allowed
            assert min(away[n] for n in truth.kept) > beam_deg / 2 - 0.51


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("beams", [None, 90, 400])
@pytest.mark.parametrize("hertz", [5, 7, 10, 12, 15])
def test_every_beam_has_the_time_of_its_samples(hertz: float, beams: int | None, order: BeamOrder) -> None:
    truth = sweep(hertz=hertz, sample_us=500, phase=0.4)
    check(truth.scan.to_laserscan(beams, order=order), truth)


# Exactly one sample lost, and not enough to be seen in the duration.
@example(6.0, 1000.0, 15.3, False, 0.0, 0.0, [(0.25, 0.0078125)], 0.0, None, 0.0, "counter-clockwise")
@example(6.0, 1000.0, 15.3, False, 0.0, 0.0, [(0.25, 0.0078125)], -0.006, None, 0.0, "counter-clockwise")
@given(
    hertz=st.floats(4, 20),
    sample_us=st.sampled_from([500.0, 1000.0]),
    seam=st.sampled_from([0.0, 0.0, 15.3, 180.0, 355.3]),
    declared=st.booleans(),
    phase=st.floats(0, 0.99),
    shift=st.floats(-0.4, 0.4),
    gaps=st.lists(st.tuples(st.floats(0, 0.95), st.floats(0.005, 0.1)), max_size=4),
    miscounted=st.floats(-0.06, 0.06),
    beams=st.none() | st.integers(1, 300),
    yaw=st.floats(-10, 10),
    order=st.sampled_from(ORDERS),
)
def test_times_are_right_whatever_the_scan_is_like(
    hertz: float,
    sample_us: float,
    seam: float,
    declared: bool,
    phase: float,
    shift: float,
    gaps: list[tuple[float, float]],
    miscounted: float,
    beams: int | None,
    yaw: float,
    order: BeamOrder,
) -> None:
    truth = sweep(
        hertz=hertz,
        sample_us=sample_us,
        seam=seam,
        declared=declared,
        phase=phase,
        shift=shift,
        gaps=gaps,
        miscounted=miscounted if gaps else 0.0,
    )
    check(truth.scan.to_laserscan(beams, mount_yaw=yaw, order=order), truth, yaw)


def test_the_grid_is_the_same_for_scans_that_begin_at_the_seam() -> None:
    kinds: list[dict[str, Any]] = [
        {},
        {"phase": 0.9},
        {"shift": -0.1},
        {"shift": 0.3},
        {"gaps": [(0.0, 0.08)]},
        {"gaps": [(0.9, 0.1)]},
    ]
    for seam in (0.0, 15.3):
        grids = [sweep(hertz=10, sample_us=500, seam=seam, **kind).scan.to_laserscan(720) for kind in kinds]
        assert [grid.angle_min for grid in grids] == pytest.approx([math.radians(0.25 - seam)] * len(kinds))


def test_a_seam_that_was_not_told_moves_the_grid() -> None:
    truth = sweep(hertz=10, sample_us=500, seam=20.0, declared=False)
    laser = truth.scan.to_laserscan(720)
    assert laser.angle_min == pytest.approx(math.radians(0.25 - 20.0), abs=1e-6)


def test_lost_packets_at_the_seam_do_not_change_the_speed() -> None:
    """The scan that begins late has too short a duration, and the one before it too long a one."""
    late = sweep(hertz=10, sample_us=500, gaps=[(0.0, 0.08)])
    assert late.scan.duration_ns == pytest.approx(92e6, rel=0.01)
    early = sweep(hertz=10, sample_us=500, gaps=[(0.9, 0.1)], miscounted=0.08)
    assert early.scan.duration_ns == pytest.approx(108e6, rel=0.01)
    for truth in (late, early):
        laser = truth.scan.to_laserscan(720)
        assert laser.scan_time == pytest.approx(0.1, rel=1e-3)
        check(laser, truth)


def test_samples_that_a_user_took_out_do_not_change_the_times() -> None:
    truth = sweep(hertz=10, sample_us=500)
    angles = truth.scan.device_angles
    outside = (angles < 100) | (angles > 140)
    thinned = replace(
        truth.scan,
        device_angles=angles[outside],
        device_distances=truth.scan.device_distances[outside],
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


def lose(case: Case, every: int) -> tuple[bytes, list[int]]:
    """The stream without every so many-th packet, and which are left; the last ones, which end a turn, are."""
    last = len(case.packets) - 2
    left = [n for n in range(len(case.packets)) if every == 0 or n % every != every // 2 or n >= last]
    return b"".join(case.packets[n] for n in left), left


_CORRECTED_BY_MUCH = ("x4", "g2", "ld14p", "a1_82")
"""Models that correct angles by 7 degrees where something came back, and by none where nothing did. Behind a lost
packet the times of their beams are off by that angle, 3 ms: what of a jump was lost cannot be told."""


@most_or_all(CASES)
def test_golden_samples_meet_the_times_of_their_beams(case: Case) -> None:
    beams_meet_their_times(case, 0)


@pytest.mark.parametrize("every", [9, 40], ids=["every 9th lost", "every 40th lost"])
@most_or_all(tuple(case for case in CASES if not any(part in case.name for part in _CORRECTED_BY_MUCH)))
def test_so_do_those_around_lost_packets(case: Case, every: int) -> None:
    beams_meet_their_times(case, every)


def beams_meet_their_times(case: Case, every: int) -> None:
    raw, left = lose(case, every)
    scans = assembled(case, raw, times=arrivals(case, left)).scans
    there = set(left)
    assert len(scans) > 1
    number = {(sample.packet, sample.index): n for n, sample in enumerate(case.samples)}
    turns = [[sample for sample in turn if sample.packet in there] for turn in case.turns]
    assert len(scans) == len(turns)
    checked = 0
    for made, turn in zip(scans, turns, strict=True):
        first = number[turn[0].packet, turn[0].index]
        laser = made.to_laserscan(720)
        period_ns = laser.scan_time * 1e9
        corrections = [(sample.angle_deg - sample.raw_deg + 180) % 360 - 180 for sample in turn]
        usual, fitted = float(np.median(corrections)), float(np.ptp(corrections)) > 0.01
        for sample, correction in zip(turn, corrections, strict=True):
            since = (number[sample.packet, sample.index] - first) * case.sample_us * 1e3
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


SPEEDS = [
    ("rplidar", 8.0),
    ("rplidar", 10.0),
    ("rplidar", 15.0),
    *(("ydlidar", hertz) for hertz in (5.0, 7.0, 12.0)),
]


@pytest.mark.parametrize(("family", "hertz"), SPEEDS)
@driven
async def test_beams_of_simulated_devices_say_when_they_were_measured(family: str, hertz: float) -> None:
    rig = make_rig(family, world=ClockWorld())
    async with rig.open() as lidar:
        await lidar.set_scan_frequency(hertz)
        scans = await take(lidar, 4)
    for made in scans:
        assert made.duration_ns == pytest.approx(1e9 / hertz, rel=0.01)
        for beams in (None, 720, 360):
            for order in ORDERS:
                laser = made.to_laserscan(beams, order=order, mount_yaw=1.0)
                off = off_ms(laser, made)
                assert len(off) > 0.6 * len(laser.ranges)
                assert max(map(abs, off)) <= 1.0 + 1e3 / hertz / len(laser.ranges)
        assert laser.range_max == 30.0


@pytest.mark.parametrize("family", FAMILIES)
@driven
async def test_beams_say_when_they_were_measured_although_packets_are_lost(family: str) -> None:
    rig = make_rig(family, world=ClockWorld())
    damage, send = Faults(flip=4e-4, seed=1), rig.device.transmit
    async with rig.open() as lidar, lidar.scans(depth=20) as stream:
        await anext(stream)
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
