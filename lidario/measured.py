"""What a scan and a part of one have in common: samples in the figures of the device, and in those of robots.

`lidario.scan` tells the convention of angles.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from lidario.samples import metres_of, radians_of

__all__ = ["MeasuredSamples"]

FloatArray = NDArray[np.float32]


class MeasuredSamples:
    """Base of the records that hold samples. The fields are those of the records themselves."""

    __slots__ = ()

    device_angles: FloatArray
    device_distances: FloatArray
    _angles: FloatArray | None
    _ranges: FloatArray | None

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
