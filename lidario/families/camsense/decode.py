"""The packets of one stretch of stream, decoded at once into arrays, as `lidario.families.two_angles` tells.

The lens sits 20 mm beside the laser. By Camsense's ``T2SDK``, with its attributes of an X1 (offset 21 degrees,
baseline 20 mm, theta 10 degrees), a return at d mm lies 21 + 90 - 10 - atan(d / 20) degrees past the beam, and is
as far away as the root of d^2 + 20^2; where nothing came back, it lies 21 - 10 degrees past it. What users found of
the zero differs by some degrees, and half of them count from the other side: a mount cures that.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import Output
from lidario.families.two_angles import TwoAngleDecoder

_NONE: Final = 0x8000
_MILLIMETRES: Final = 0x3FFF
_OFFSET_DEG: Final = 21.0
_THETA_DEG: Final = 10.0
_BASELINE_MM: Final = 20.0


class PacketDecoder(TwoAngleDecoder):
    """Decodes the packets of one stream."""

    def _read(self, measured: NDArray[Any], output: Output) -> None:
        words = measured["distance"]
        output.distance[...] = np.where(words & _NONE, 0, words & _MILLIMETRES)
        output.intensity[...] = np.minimum(measured["quality"], 255)

    def _corrected(self, output: Output) -> NDArray[np.float64]:
        d = output.distance.astype(np.float64)
        # A quarter turn where nothing came back: then it is 11 degrees past the beam, as the vendor has it.
        back = np.where(d > 0, np.degrees(np.arctan(d / _BASELINE_MM)), 90.0)
        np.copyto(output.distance, np.hypot(d, _BASELINE_MM), where=d > 0, casting="same_kind")
        return back - (_OFFSET_DEG + 90.0 - _THETA_DEG)
