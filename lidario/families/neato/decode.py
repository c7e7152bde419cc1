"""The packets of one stretch of stream, decoded at once into arrays, as `lidario.families.slots` tells.

A sample stands at a whole degree, counted in the sense in which the rotor turns: counter-clockwise in an XV-11 (the
viewer in Xevel/NXV11 plots it so), clockwise in the others. Weak returns are delivered: in the recording their
distances are as plausible as those of others, at a fifth of the strength. Strengths are divided by 8, so that 2040
is the largest one that is told; 1202 is the largest one in the recording.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.slots import DegreeDecoder

_NONE: Final = 0x8000
_MILLIMETRES: Final = 0x3FFF


class PacketDecoder(DegreeDecoder):
    """Decodes the packets of one stream."""

    def _returns(self, rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        words = rows["samples"]["distance"]
        strength = np.minimum(rows["samples"]["strength"] >> 3, 255)
        return np.where(words & _NONE, 0, words & _MILLIMETRES), strength
