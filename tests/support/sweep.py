"""Scans of one revolution whose distances say which sample each is, and the check of the times of their beams."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lidario.scans.beams import BeamOrder
from lidario.scans.laserscan import LaserScan
from lidario.scans.scan import Scan
from tests.scans.test_scan import scan

EVERY_MS = 1e6
ORDERS: tuple[BeamOrder, ...] = ("counter-clockwise", "measured")
WALL = 10**18
"""Wall clock at the beginning of each revolution."""


def apart(one: float, other: float) -> float:
    """Degrees between two directions."""
    return abs((one - other + 180) % 360 - 180)


@dataclass(frozen=True)
class Sweep:
    """A scan whose distances say which sample each is, and the truth about it."""

    scan: Scan  # sample `n` of the revolution has a distance of 1000 + n millimetres
    wall_ns: list[float]  # time of each sample of the revolution, the missing ones included
    angle_deg: list[float]  # device angle of each
    period_ns: float  # time of a revolution

    @property
    def kept(self) -> list[int]:
        """The samples that are in the scan."""
        return [round(float(each)) - 1000 for each in self.scan.device_distances]


def sweep(
    *,
    hertz: float,
    sample_us: float,
    seam: float = 0.0,  # device angle where it begins
    declared: bool = True,  # whether the scan says so
    phase: float = 0.0,  # part of a sample by which the first one comes after the seam
    shift: float = 0.0,  # degrees by which all angles are read too large
    gaps: Sequence[tuple[float, float]] = (),  # begin and length of what is lost, as parts of the revolution
    miscounted: float = 0.0,  # part of the revolution that `duration_ns` has too much
) -> Sweep:
    """A revolution of a rotor that turns evenly."""
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
