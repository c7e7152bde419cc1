"""Filters that look at one sample at a time: its angle, its range, its intensity."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import number, shown, yes_or_no
from lidario.errors import InvalidValue
from lidario.filters.base import MaskFilter
from lidario.scans.measured import MeasuredSamples
from lidario.scans.samples import in_single, is_between


@dataclass(frozen=True, slots=True)
class AngularBoundsFilter(MaskFilter):
    """Keeps what lies in windows of angles, or takes it out.

    In a direction that is taken out, a sample where nothing came back is taken out too: nobody shall read there
    that the way is free. ::

        AngularBoundsFilter([(-1.57, 1.57)])                     # the front half alone
        AngularBoundsFilter([(2.0, 2.2), (-2.2, -2.0)], invert=True)  # two posts of the robot

    Attributes:
        windows: Each from the first angle counter-clockwise to the second, radians of at most a turn.
        invert: Whether the windows are taken out, and all else is kept.

    Raises:
        InvalidValue: The windows are not pairs of finite angles of at most a turn.
    """

    windows: Iterable[tuple[float, float]]
    invert: bool = False

    def __post_init__(self) -> None:
        try:
            windows = tuple((begin, end) for begin, end in self.windows)
        except (TypeError, ValueError):
            raise InvalidValue(
                f"windows are a list of (begin, end), each two angles in radians, not {shown(self.windows)}"
            ) from None
        for window in windows:
            is_between(np.zeros(0, np.float32), window)
        object.__setattr__(self, "windows", tuple((float(begin), float(end)) for begin, end in windows))
        object.__setattr__(self, "invert", yes_or_no(self.invert, "invert"))

    def leaves_out(self, record: MeasuredSamples, /) -> NDArray[np.bool_]:
        inside = np.zeros(len(record), np.bool_)
        for window in self.windows:
            inside |= is_between(record.angles, window)
        return inside if self.invert else ~inside


@dataclass(frozen=True, slots=True)
class RangeFilter(MaskFilter):
    """Takes out returns that are too near or too far; a sample without a return stays what it is.

    Attributes:
        lower_threshold: Metres; nearer returns are taken out.
        upper_threshold: Metres; farther returns are taken out.

    Raises:
        InvalidValue: They are no numbers, or the first is above the second.
    """

    lower_threshold: float = 0.0
    upper_threshold: float = math.inf

    def __post_init__(self) -> None:
        _check_thresholds(self)

    def leaves_out(self, record: MeasuredSamples, /) -> NDArray[np.bool_]:
        lower, upper = in_single(self.lower_threshold), in_single(self.upper_threshold)
        # Comparing with NaN gives False.
        return (record.ranges < lower) | (record.ranges > upper)


@dataclass(frozen=True, slots=True)
class IntensityFilter(MaskFilter):
    """Takes out returns that are too weak or too strong; where the format carries no intensities, none.

    Attributes:
        lower_threshold: On the device's own scale of 0..255; weaker returns are taken out.
        upper_threshold: On that scale; stronger returns are taken out.

    Raises:
        InvalidValue: They are no numbers, or the first is above the second.
    """

    lower_threshold: float = 0.0
    upper_threshold: float = 255.0

    def __post_init__(self) -> None:
        _check_thresholds(self)

    def leaves_out(self, record: MeasuredSamples, /) -> NDArray[np.bool_]:
        if record.intensities is None:
            return np.zeros(len(record), np.bool_)
        # Whole numbers are compared with whole numbers, which are in the range of a byte.
        weak = record.intensities < math.ceil(min(max(self.lower_threshold, 0.0), 256.0))
        strong = record.intensities > math.floor(min(max(self.upper_threshold, -1.0), 255.0))
        return record.valid & (weak | strong)


def _check_thresholds(of: RangeFilter | IntensityFilter) -> None:
    lower, upper = number(of.lower_threshold, "lower_threshold"), number(of.upper_threshold, "upper_threshold")
    if lower > upper:
        raise InvalidValue(f"lower_threshold {lower:g} is above upper_threshold {upper:g}")
    object.__setattr__(of, "lower_threshold", lower)
    object.__setattr__(of, "upper_threshold", upper)
