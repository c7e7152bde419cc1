"""The packets of one stretch of stream, decoded at once into arrays, as `lidario.families.slots` tells.

ROBOTIS' driver stores sample k at 359 - k degrees counter-clockwise, so the device counts clockwise; exactly
mirrored it would be 360 - k, which is what is given here. Intensities have no documented scale; they are
divided by 32, so that 8160 is the largest one that is told.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidario.families.slots import DegreeDecoder


class PacketDecoder(DegreeDecoder):
    """Decodes the packets of one stream."""

    def _returns(self, rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        samples = rows["samples"]
        return samples["distance"], np.minimum(samples["intensity"] >> 5, 255)
