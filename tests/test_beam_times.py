"""When each beam of a LaserScan says that it was measured, against scans made here.

Their distances say which sample each one is. `tests.test_beam_times_of_devices` checks the same on streams.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lidario.beams import BeamOrder
from lidario.rotor import follow_rotor, times_of
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
