"""Makes a `Scan` of the arrays and the times of one revolution."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Stream
from lidario.revolution.partial import SampleArrays
from lidario.scans.measured import made_of
from lidario.scans.rotor import Gaps
from lidario.scans.samples import read_only
from lidario.scans.scan import Scan


class DatedRevolution(NamedTuple):
    """A revolution whose samples and times are known."""

    arrays: SampleArrays  # its samples, with the zero-angle offset
    start_ns: int  # when the first of them was measured
    spanned_ns: float  # how long the samples took, with those that are missing
    revolution_ns: float  # time of a whole revolution, by the step of its angle; NaN or 0 if unknown
    reported_rpm: float  # the speed that its packets tell; NaN where they tell none
    # Where samples are missing among its own, and how many, as `Samples.gaps`; None if that is not certain.
    gaps: Gaps | None = ()


def turned_by(degrees: NDArray[np.float32], offset: float) -> NDArray[np.float32]:
    """Angles with an offset added, in [0, 360); the same array where there is none."""
    if not offset:
        return degrees
    turned = ((degrees.astype(np.float64) + offset) % 360.0).astype(np.float32)
    # Just below 360 degrees, single precision rounds up to 360.
    turned[turned >= 360.0] = 0.0
    return turned


def build_scan(
    stream: Stream, revolution: DatedRevolution, *, wall_ns: int, sample_ns: float, seq: int, lost: int
) -> Scan:
    """The scan of one revolution; its arrays become read-only.

    Args:
        stream: The stream it belongs to.
        revolution: The revolution.
        wall_ns: When its first sample was measured, on the wall clock.
        sample_ns: Nanoseconds a sample.
        seq: Number of the scan.
        lost: Packets missing in it.
    """
    arrays, start_ns, spanned_ns, revolution_ns, reported_rpm, gaps = revolution
    return made_of(
        Scan,
        device_angles=read_only(arrays.angle),
        device_distances=read_only(arrays.distance),
        intensities=None if arrays.intensity is None else read_only(arrays.intensity),
        stamp_ns=start_ns,
        wall_stamp_ns=wall_ns,
        time_increment_ns=round(sample_ns),
        duration_ns=round(spanned_ns),
        rpm=60e9 / revolution_ns if revolution_ns else math.nan,
        seq=seq,
        dropped_before=0,
        lost_packets=lost,
        mode=stream.mode.name,
        max_range=stream.mode.max_distance,
        seam=(stream.format.begin_deg + stream.zero_offset_deg) % 360.0,
        reported_rpm=reported_rpm,
        field_of_view=stream.format.field_deg,
        _gaps=gaps,
    )
