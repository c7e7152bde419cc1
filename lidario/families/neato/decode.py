"""The packets of one stretch of stream, decoded at once into arrays, as `lidario.families.slots` tells.

A sample stands at a whole degree, counted in the sense in which the rotor turns: counter-clockwise in an XV-11 (the
viewer in Xevel/NXV11 plots it so), clockwise in the others. Weak returns are delivered: in the recording their
distances are as plausible as those of others, at a fifth of the strength. Strengths are divided by 8, so that 2040
is the largest one that is told; 1202 is the largest one in the recording.
"""

from __future__ import annotations

from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.neato.formats import BackFormat, PacketFormat
from lidario.families.slots import DegreeDecoder, DegreeFormat

_NONE: Final = 0x8000
_MILLIMETRES: Final = 0x3FFF


class PacketDecoder(DegreeDecoder):
    """Decodes the packets of one stream; of a rotor that turns clockwise."""

    wire: ClassVar[type[DegreeFormat]] = PacketFormat

    def _returns(self, rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        words = rows["samples"]["distance"]
        strength = np.minimum(rows["samples"]["strength"] >> 3, 255)
        return np.where(words & _NONE, 0, words & _MILLIMETRES), strength


class BackDecoder(PacketDecoder):
    """Decodes the packets of one stream of an XV-11, which turns counter-clockwise."""

    wire: ClassVar[type[DegreeFormat]] = BackFormat
