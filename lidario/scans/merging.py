"""Several lidars as one: which of their scans belong together, and the one cloud and the one LaserScan they make.

Lidars turn at their own pace. A cloud is made as soon as each of them has a new scan, or when one has its next
before the others have theirs. The others are in it with their latest scan, as long as that is young; one that is
silent is told in `Merged.missing`, and holds nobody up.

A LaserScan must tell three things apart: a direction in which nothing came back, so that the way is free; one in
which filters took out what came back; and one in which nobody has looked. So the cloud knows the samples without a
return, too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import callable_of, moderate, shown
from lidario.errors import InvalidValue
from lidario.scans.beams import FARTHEST_STATED_M, NO_RETURN, BeamOptions, NoReturn, beam_count
from lidario.scans.laserscan import LaserScan
from lidario.scans.laserscans import rotor_in_time
from lidario.scans.points import Motion, Mount, Points, Velocity, merge, place
from lidario.scans.samples import FloatArray
from lidario.scans.scan import Scan

OLDEST_S = 0.25  # two and a half revolutions of 10 Hz: a robot of 1 m/s has driven a quarter of a metre


@dataclass(frozen=True, slots=True, eq=False)
class Merged:
    """The scans of several lidars as one cloud, in the robot's frame.

    Attributes:
        points: All returns; `Points.source` says which lidar each came from.
        at_ns: The instant in whose frame they are, on the clock of `Scan.stamp_ns`: the end of the latest scan.
        wall_at_ns: The same since the Unix epoch.
        scan_time: Seconds of the longest revolution.
        missing: Numbers of the lidars that have no scan young enough.
        max_range: Metres that the lidar which sees farthest says; 0 where none says it.
        free: Where the samples end from which nothing came back, `max_range` away from their lidar (40 m where none
            says it); metres, float32, shape (n, 2).
        left_out: Likewise of the samples that filters took out.
    """

    points: Points
    at_ns: int
    wall_at_ns: int
    scan_time: float
    missing: tuple[int, ...]
    max_range: float
    free: NDArray[np.float32]
    left_out: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.points)

    def to_laserscan(
        self,
        beams: int = 720,
        *,
        frame_id: str = "base_link",
        range_min: float = 0.05,
        range_max: float | None = None,
        no_return: NoReturn = "inf",
        filtered: NoReturn = "nan",
    ) -> LaserScan:
        """One LaserScan around the robot's origin; of the points in one direction, the nearest.

        All of it is of one instant, `wall_at_ns`, so `time_increment` is 0. A direction in which no lidar has
        looked is NaN: beside a field of view, between two samples, or where the lidar that looks there is missing.

        Args:
            beams: How many, evenly over the whole turn; the first one at -pi.
            frame_id: Name of the robot's frame.
            range_min: Metres from the robot's origin; nearer points are left out.
            range_max: Metres; farther points count as no return. None to keep all.
            no_return: What a direction has from which nothing came back: ``inf``, ``nan`` or ``zero``.
            filtered: What a direction has in which filters took out all there was; the same words.

        Raises:
            InvalidValue: One of them cannot be right.
        """
        beams = beam_count(beams)
        chosen = BeamOptions("counter-clockwise", frame_id, range_min, range_max, no_return, filtered)
        near, far = float(range_min), chosen.farthest
        xy = self.points.xy.astype(np.float64)
        ranges = np.hypot(xy[:, 0], xy[:, 1])
        kept = np.flatnonzero((ranges >= near) & (ranges <= far))
        # The nearest one last: of several values for one place, the last one stays.
        kept = kept[np.argsort(-ranges[kept], kind="stable")]
        beam = _beams_of(xy[kept], beams)
        made = np.full(beams, np.nan, np.float32)
        made[_beams_of(self.left_out, beams)] = NO_RETURN[filtered]
        made[_beams_of(np.concatenate((self.free, xy[ranges > far])), beams)] = NO_RETURN[no_return]
        made[beam] = ranges[kept]
        strengths = np.zeros(0, np.float32)
        if self.points.intensities is not None:
            strengths = np.zeros(beams, np.float32)
            strengths[beam] = self.points.intensities[kept]
        step = math.tau / beams
        return LaserScan(
            stamp_ns=self.wall_at_ns,
            frame_id=frame_id,
            angle_min=-math.pi,
            angle_max=math.pi - step,
            angle_increment=step,
            time_increment=0.0,
            scan_time=self.scan_time,
            range_min=near,
            range_max=far if range_max is not None else self.max_range or FARTHEST_STATED_M,
            ranges=made,
            intensities=strengths,
        )


class MergedScans:
    """Brings the scans of several lidars together, as for `lidario.merged`."""

    def __init__(self, mounts: Sequence[Mount], motion: Motion | None = None, oldest_s: float = OLDEST_S) -> None:
        if not 0 < len(mounts) <= 256 or not all(isinstance(each, Mount) for each in mounts):
            raise InvalidValue(f"one lidar to 256 can be merged, each with a Mount, not {shown(mounts)}")
        if motion is not None and not isinstance(motion, Velocity):
            callable_of(motion, "motion that is no Velocity")
        if not moderate(oldest_s, "oldest_s") > 0:
            raise InvalidValue(f"oldest_s is seconds above 0, not {oldest_s:g}")
        self._mounts = tuple(mounts)
        self._motion = motion
        self._oldest_ns = round(oldest_s * 1e9)
        self._latest: dict[int, Scan] = {}
        self._new: set[int] = set()

    def take(self, number: int, scan: Scan, *, more: bool = False) -> Merged | None:
        """Take the next scan of lidar `number`; the cloud, where one is ready.

        Where `more` are there already, none is: they belong to it, as where the program was busy for a while.
        """
        again = number in self._new
        self._latest[number] = scan
        self._new.add(number)
        if more:
            return None
        at_ns = max(map(_end_of, self._latest.values()))
        young = {each: scan for each, scan in self._latest.items() if at_ns - _end_of(scan) <= self._oldest_ns}
        if not again and not self._new >= young.keys():
            return None
        self._new.clear()
        return self._merged(young, at_ns)

    def _merged(self, scans: dict[int, Scan], at_ns: int) -> Merged:
        # In the order of the lidars, with nothing for those that are silent: so `source` is the number.
        empty = merge()
        clouds = [
            scans[each].points(mount, motion=self._motion, at_ns=at_ns) if each in scans else empty
            for each, mount in enumerate(self._mounts)
        ]
        last = max(scans.values(), key=_end_of)
        max_range = max(scan.max_range for scan in scans.values())
        open_ways = [
            self._ends(scan, self._mounts[each], at_ns, max_range or FARTHEST_STATED_M)
            for each, scan in scans.items()
        ]
        return Merged(
            merge(*clouds),
            at_ns,
            at_ns + last.wall_stamp_ns - last.stamp_ns,
            max(rotor_in_time(scan).period_ns for scan in scans.values()) * 1e-9,
            tuple(each for each in range(len(self._mounts)) if each not in scans),
            max_range,
            np.concatenate([free for free, _ in open_ways]),
            np.concatenate([left_out for _, left_out in open_ways]),
        )

    def _ends(self, scan: Scan, mount: Mount, at_ns: int, far: float) -> tuple[FloatArray, FloatArray]:
        """So far away on the samples without a return, and on those that filters took out."""
        none = np.flatnonzero(~scan.valid)
        cos, sin = (each[none] for each in scan.directions())
        ends = place(np.stack((cos, sin), axis=1) * far, scan.times_ns[none], mount, self._motion, at_ns)
        is_out = scan.left_out[none]
        return ends[~is_out], ends[is_out]


def _beams_of(xy: NDArray[np.floating], beams: int) -> NDArray[np.int64]:
    """The beam of each point: one has the directions around it, half a step on both sides."""
    turned = np.arctan2(xy[:, 1], xy[:, 0], dtype=np.float64) + math.pi
    found: NDArray[np.int64] = np.rint(turned * (beams / math.tau)).astype(np.int64) % beams
    return found


def _end_of(scan: Scan) -> int:
    return scan.stamp_ns + scan.duration_ns
