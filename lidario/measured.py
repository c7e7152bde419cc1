"""What a scan and a part of one have in common: samples in the figures of the device, and in those of robots.

`lidario.scan` tells the convention of angles.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from lidario.rotor import Gaps
from lidario.samples import metres_of, radians_of

__all__ = ["MeasuredSamples", "later", "with_dropped", "with_gaps"]

_RecordT = TypeVar("_RecordT", bound="MeasuredSamples")

FloatArray = NDArray[np.float32]


class MeasuredSamples:
    """Base of the records that hold samples. The fields are those of the records themselves."""

    __slots__ = ()

    device_angles: FloatArray
    device_distances: FloatArray
    _angles: FloatArray | None
    _ranges: FloatArray | None
    # Where samples are missing; None where that is not known.
    _gaps: Gaps | None

    def __len__(self) -> int:
        return len(self.device_distances)

    @property
    def angles(self) -> FloatArray:
        """Radians, float32, counter-clockwise, in [-pi, pi]; 0 is the device's forward axis."""
        if self._angles is None:
            object.__setattr__(self, "_angles", radians_of(self.device_angles))
        return cast("FloatArray", self._angles)

    @property
    def ranges(self) -> FloatArray:
        """Metres, float32; NaN where nothing came back."""
        if self._ranges is None:
            object.__setattr__(self, "_ranges", metres_of(self.device_distances))
        return cast("FloatArray", self._ranges)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask of the samples with a return, shape (n,)."""
        return self.device_distances > 0

    def xy(self) -> NDArray[np.float32]:
        """Cartesian points in metres, float32, shape (n, 2): x forward, y left; NaN rows without a return."""
        return np.stack((self.ranges * np.cos(self.angles), self.ranges * np.sin(self.angles)), axis=1)


def with_gaps(record: _RecordT, gaps: Gaps | None) -> _RecordT:
    """A new record, told where samples are missing in it."""
    object.__setattr__(record, "_gaps", gaps)
    return record


def later(record: _RecordT, by_ns: int) -> _RecordT:
    """The same record, measured so much later."""
    fields: Any = record
    made: _RecordT = replace(fields, stamp_ns=fields.stamp_ns + by_ns, wall_stamp_ns=fields.wall_stamp_ns + by_ns)
    return with_gaps(made, record._gaps)  # noqa: SLF001 - of this module


def with_dropped(record: _RecordT, dropped: int) -> _RecordT:
    """The same record, with so many dropped before it."""
    fields: Any = record
    made: _RecordT = replace(fields, dropped_before=dropped)
    return with_gaps(made, record._gaps)  # noqa: SLF001 - of this module
