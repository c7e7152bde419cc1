"""A scan on the even grid of angles that the ROS message ``sensor_msgs/LaserScan`` describes, with right times.

Each sample goes to the beam whose share of the circle contains it. The nearest return wins where several samples
meet in one beam. A beam without any sample is NaN, because nothing is known about it.

**The choice of the grid.** The message promises that beam ``i`` was measured at ``stamp + i * time_increment``.
This is one straight line in time over the whole grid, so the grid must begin and end where the revolution begins
and ends: from 0 to 2 pi. With a counter-clockwise grid that begins at -pi, half of the beams would be wrong by half
a revolution. docs/ros2.md tells which fields laser_geometry, slam_toolbox, nav2 and cartographer use, and which
order of the beams serves each of them.

Each beam stands in the middle of its share of the circle. With beams on the ends of the grid, the first and the
last share would be one and the same, and would contain samples from both ends of the revolution.

**A device that sees less than a turn** has a grid of its field alone (`Scan.field_of_view`): beside it nothing is
known, and "no return" would say that the way is free there.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import finite, number, shown, text_of, whole
from lidario.errors import InvalidValue
from lidario.scans.laserscan import LaserScan
from lidario.scans.rotor import Rotor, before, turned, within_turn
from lidario.scans.samples import in_single

if TYPE_CHECKING:
    from lidario.scans.scan import Scan

BeamOrder = Literal["counter-clockwise", "measured"]
NoReturn = Literal["inf", "nan", "zero"]
Preset = Literal["rep103", "vendor"]
"""Where the angle 0 of a LaserScan is: ``rep103`` ahead, ``vendor`` behind, as in the vendors' ROS 2 drivers."""
PRESET_YAW: Final = {"rep103": 0.0, "vendor": math.pi}  # angle of the device's forward axis by each preset, radians
_ORDERS = ("counter-clockwise", "measured")
NO_RETURN: Final = {"inf": math.inf, "nan": math.nan, "zero": 0.0}
"""What the words of `NoReturn` stand for, metres."""

FARTHEST_STATED_M: Final = 40.0
"""Metres: `LaserScan.range_max` where neither the caller nor the device says one. Beyond all models supported."""

_MOST_BEAMS = 1_000_000
"""Hundreds of times as many as any scan has samples; more than that is a mistake, and would take all memory."""

_ROUNDING_DEG = 1e-4
"""Samples at most this far before a beam belong to it: angles are float32, 3e-5 degrees apart below 360."""

_EDGE_DEG = 15.0
"""Samples at most this far beyond an end of the grid belong to the beam at that end.

Only corrected angles go that far, by 13 degrees, and only for close returns: there the correction moves a point
by a few centimetres whatever its angle is.
"""


@dataclass(frozen=True, slots=True)
class BeamOptions:
    """What a user chooses of a LaserScan: the arguments of `Scan.to_laserscan` of these names.

    They are checked before the first scan comes, and refused as there.
    """

    order: BeamOrder = "counter-clockwise"
    frame_id: str = "laser"
    range_min: float = 0.05
    range_max: float | None = None
    no_return: NoReturn = "inf"
    filtered: NoReturn = "nan"
    mount_yaw: float = 0.0
    preset: Preset = "rep103"

    def __post_init__(self) -> None:
        for name, word, words in (
            ("order", self.order, _ORDERS),
            ("no_return", self.no_return, NO_RETURN),
            ("filtered", self.filtered, NO_RETURN),
            ("preset", self.preset, PRESET_YAW),
        ):
            if not isinstance(word, str) or word not in words:
                raise InvalidValue(f"{name} must be one of {', '.join(words)}, not {shown(word)}")
        text_of(self.frame_id, "frame_id")
        finite(self.mount_yaw, "mount_yaw")
        nearest = finite(self.range_min, "range_min")
        if not 0 <= nearest <= self.farthest or in_single(nearest) == math.inf:
            raise InvalidValue(f"range_min must be between 0 and range_max: {nearest} to {self.farthest}")

    @property
    def farthest(self) -> float:
        """Metres beyond which a return counts as none."""
        return math.inf if self.range_max is None else in_single(number(self.range_max, "range_max"))


def resample(scan: "Scan", rotor: Rotor, options: BeamOptions, beams: SupportsIndex | None = None) -> LaserScan:
    """Put the samples of a scan, in the order of measuring, on a grid of equal steps.

    The rotor turned so during the scan. There are as many beams as samples where the user says nothing.
    """
    count = beam_count(len(scan) if beams is None else beams)
    nearest, farthest = float(options.range_min), options.farthest
    if options.range_max is not None:
        stated = farthest
    else:
        stated = float(scan.max_range) if 0 < in_single(scan.max_range) < math.inf else FARTHEST_STATED_M

    ranges, left_out = scan.ranges, scan.left_out
    places = _places(scan.device_angles, rotor, count)
    on_grid = places >= 0
    # Comparing with NaN gives False: a sample without a return is no hit.
    hit = on_grid & (ranges >= nearest) & (ranges <= farthest)
    filled = np.full(count, np.nan, np.float32)
    # First, so that every other sample of the beam says more.
    filled[places[left_out & on_grid]] = NO_RETURN[options.filtered]
    filled[places[on_grid & ~hit & ~left_out]] = NO_RETURN[options.no_return]
    hit_places, hit_ranges = places[hit], ranges[hit]
    # First any return of a beam, in place of what stands there (NaN is below nothing), then the nearest one.
    filled[hit_places] = hit_ranges
    np.minimum.at(filled, hit_places, hit_ranges)
    strengths = np.zeros(0 if scan.intensities is None else count, np.float32)
    if scan.intensities is not None:
        nearest_ones = np.flatnonzero(hit)[hit_ranges == filled[hit_places]]
        # Of equal ones the first.
        strengths[places[nearest_ones[::-1]]] = scan.intensities[nearest_ones[::-1]]

    field, rises = abs(rotor.field_deg), rotor.field_deg < 0
    step = math.radians(field) / count
    beam_ns = rotor.period_ns * (field / 360.0) / count
    # The grid covers the field counter-clockwise from here. In [-pi, pi): 0 where a circle is not turned.
    right_deg = rotor.begin_deg if rises or field == 360.0 else rotor.begin_deg + field
    ahead_deg = math.degrees(float(options.mount_yaw) + PRESET_YAW[options.preset])
    lowest = before(ahead_deg - right_deg, 180.0) * math.pi / 180.0
    angles = (lowest + step / 2, lowest + step * (count - 0.5))
    # A rotor that turns counter-clockwise measures in the order of rising angles: then both orders are one.
    measured = rises or options.order == "measured"
    falls = measured and not rises
    first_beam_ns = beam_ns * (0.5 if measured else count - 0.5)
    return LaserScan(
        stamp_ns=scan.wall_stamp_ns + round(rotor.begin_ns + first_beam_ns),
        frame_id=options.frame_id,
        angle_min=angles[1] if falls else angles[0],
        angle_max=angles[0] if falls else angles[1],
        angle_increment=-step if falls else step,
        time_increment=(beam_ns if measured else -beam_ns) * 1e-9,
        scan_time=rotor.period_ns * 1e-9,
        range_min=nearest,
        range_max=stated,
        ranges=filled if measured else filled[::-1].copy(),
        intensities=strengths if measured else strengths[::-1].copy(),
    )


def beam_count(beams: SupportsIndex) -> int:
    """The number of beams, if a grid may have so many: 1 to 1000000."""
    count = whole(beams, "beams")
    if not 1 <= count <= _MOST_BEAMS:
        raise InvalidValue(f"a grid has 1 to {_MOST_BEAMS} beams, not {shown(count)}")
    return count


def _places(device_angles: NDArray[np.floating], rotor: Rotor, count: int) -> NDArray[np.intp]:
    """The beam of each sample, counted in the order of measuring; -1 beside the grid."""
    begin_deg, field = rotor.begin_deg, rotor.field_deg
    if not len(device_angles):
        return np.zeros(0, np.intp)
    away = within_turn(math.copysign(1.0, field) * (device_angles.astype(np.float64) - begin_deg))
    if abs(field) != 360.0:
        away = (away + _ROUNDING_DEG) % 360.0 - _ROUNDING_DEG
    # Evenly spaced samples stand at the edges of as many beams, and rounding must not put two of them into one.
    places = np.minimum(((away + _ROUNDING_DEG) * (count / abs(field))).astype(np.intp), count - 1)
    if abs(field) != 360.0:
        # Only where somebody has chosen another begin is a sample farther away than rounding explains.
        places[away > abs(field) + _ROUNDING_DEG] = -1
        return places
    if field < 0.0:
        return places
    way = turned(device_angles, begin_deg)
    if way[-1] > way[0]:
        # Beyond an end of the grid the angle alone would give the beam at the other end, a revolution off in time.
        # Where the samples go on and on there, the grid begins amid the revolution, and only the angle tells.
        if way.min() >= -_EDGE_DEG:
            places[way < 0.0] = 0
        if way.max() < 360.0 + _EDGE_DEG:
            places[way >= 360.0] = count - 1
    return places
