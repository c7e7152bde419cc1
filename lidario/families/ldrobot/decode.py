"""The packets of one stretch of stream, decoded at once into arrays, as `lidario.families.arcs` tells.

The vendor's SDK divides the span of a packet in whole hundredths of a degree; here it is exact.

Angles of models that triangulate are corrected by atan((0.11923 d - c) / (d + 5.9)), d in mm. So neighbours can
change places; revolutions are divided by the uncorrected angle.

* LD14 and LD14P: c is 18.975571, and the distance stays as it is (the vendor's ``sl_transform.cpp``). Where nothing
  came back, the angle has the correction before.
* LD08: c is 20.14, and the distance is that from the axis, the root of (d + 5.9)^2 + (0.11923 d - 20.14)^2
  (ROBOTIS, ``hls_lfcd_lds_driver``, ``transform.cpp``). Where nothing came back, the angle is that of the beam.
"""

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import Output
from lidario.families.two_angles import TwoAngleDecoder, TwoAngleFormat


class TriangleDecoder(TwoAngleDecoder):
    """Decodes the packets of one stream of an LD14 or LD14P."""

    def __init__(self, wire: type[TwoAngleFormat]) -> None:
        super().__init__(wire)
        self._last = 0.0

    def _corrected(self, output: Output) -> NDArray[np.float64]:
        d = output.distance.astype(np.float64).ravel()
        shift = np.degrees(np.arctan((0.11923 * d - 18.975571) / (d + 5.9)))
        # Where nothing came back, the correction of the sample before.
        latest = np.maximum.accumulate(np.where(d > 0, np.arange(len(d)), -1))
        shift = np.where(latest >= 0, shift[latest], self._last)
        self._last = float(shift[-1])
        return shift.reshape(output.angle.shape)


class AxisDecoder(TwoAngleDecoder):
    """Decodes the packets of one stream of an LD08."""

    def _corrected(self, output: Output) -> NDArray[np.float64]:
        d = output.distance.astype(np.float64)
        ahead, aside = d + 5.9, 0.11923 * d - 20.14
        np.copyto(output.distance, np.hypot(ahead, aside), where=d > 0, casting="same_kind")
        return np.where(d > 0, np.degrees(np.arctan(aside / ahead)), 0.0)
