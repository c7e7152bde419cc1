"""The arrays of one revolution and what is known of its time, made a `Scan`."""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Stream
from lidario.measured import MeasuredSamples
from lidario.revolution.partial import SampleArrays
from lidario.rotor import Gaps
from lidario.scan import Scan, read_only

__all__ = ["DatedRevolution", "build_scan", "turned_by"]


class DatedRevolution(NamedTuple):
    """A revolution whose samples and times are known.

    Attributes:
        arrays: Its samples, with the zero-angle offset.
        start_ns: When the first of them was measured.
        spanned_ns: How long they took.
        revolution_ns: What a whole one takes, by the step of its angle; NaN or 0 where that is not known.
        reported_rpm: The speed that its packets tell; NaN where they tell none.
        gaps: Where samples are missing among its own, and how many: as `Samples.gaps`. None where that is not
            certain.
    """

    arrays: SampleArrays
    start_ns: int
    spanned_ns: float
    revolution_ns: float
    reported_rpm: float
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
        revolution: What is known of it.
        wall_ns: When its first sample was measured, on the wall clock.
        sample_ns: Nanoseconds a sample.
        seq: Its number.
        lost: Packets missing in it.
    """
    made = _Unfrozen(stream, revolution, wall_ns, sample_ns, seq, lost)
    made.__class__ = Scan  # type: ignore[assignment]
    return cast("Scan", made)


class _Unfrozen(MeasuredSamples):
    """A `Scan` while its fields are set.

    A frozen dataclass sets each of its 24 fields by a call: 2.6 us once a revolution, where plain assignments take
    0.3. Both classes have the same slots, so one can become the other.
    """

    __slots__ = Scan.__slots__

    def __init__(
        self, stream: Stream, revolution: DatedRevolution, wall_ns: int, sample_ns: float, seq: int, lost: int
    ) -> None:
        arrays, start_ns, spanned_ns, revolution_ns, reported_rpm, gaps = revolution
        self.device_angles = read_only(arrays.angle)
        self.device_distances = read_only(arrays.distance)
        self.intensities = None if arrays.intensity is None else read_only(arrays.intensity)
        self.stamp_ns = start_ns
        self.wall_stamp_ns = wall_ns
        self.time_increment_ns = round(sample_ns)
        self.duration_ns = round(spanned_ns)
        self.rpm = 60e9 / revolution_ns if revolution_ns > 0 else math.nan
        self.seq = seq
        self.dropped_before = 0
        self.lost_packets = lost
        self.mode = stream.mode.name
        self.max_range = stream.mode.max_distance
        self.seam = (stream.format.begin_deg + stream.zero_offset_deg) % 360.0
        self.field_of_view = stream.format.field_deg
        self.reported_rpm = reported_rpm
        self._gaps = gaps if lost else None
        self._angles = self._ranges = self._measured = self._times_ns = self._rotor = None
        self._left_out = self._directions = None
