"""The packets of one stretch of stream, decoded at once into arrays, as `lidario.families.arcs` tells.

The vendor's SDK divides the span of a packet in whole hundredths of a degree; here it is exact.

Models that triangulate see with a lens beside the laser. Their angles are corrected by the distance (the vendor's
``sl_transform.cpp``): by atan((0.11923 d - 18.975571) / (d + 5.9)), d in mm, and where nothing came back by the
correction before. So neighbours can change places; revolutions are divided by the uncorrected angle.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Floats, Ints
from lidario.families.ldrobot.formats import FULL_TURN, PACKET, SAMPLES

__all__ = ["PacketDecoder", "TriangleDecoder", "samples_a_second"]

UNITS: Final = 100.0 * (SAMPLES - 1)
"""In a degree, where every sample of a packet stands at a whole number."""


class PacketDecoder(ArcDecoder):
    """Decodes the packets of one stream; angles are those of the beam."""

    packet = PACKET
    samples = SAMPLES
    full_turn = FULL_TURN

    def _angles(self, rows: NDArray[np.void]) -> tuple[Ints, Ints]:
        return rows["start"].astype(np.int32), rows["end"].astype(np.int32)

    def _measured(self, rows: NDArray[np.void]) -> tuple[NDArray[np.generic], NDArray[np.generic]]:
        measured = rows["samples"]
        return measured["distance"], measured["intensity"]

    def _rpm(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        return rows["speed"] / 6


class TriangleDecoder(PacketDecoder):
    """Decodes the packets of one stream of a model that triangulates."""

    def __init__(self) -> None:
        self._last = 0.0

    def _finish(self, angle: Floats, distance: Floats) -> float:
        d = distance.astype(np.float64)
        shift = np.degrees(np.arctan((0.11923 * d - 18.975571) / (d + 5.9)))
        # Where nothing came back, the correction of the sample before.
        latest = np.maximum.accumulate(np.where(d > 0, np.arange(len(d)), -1))
        shift = np.where(latest >= 0, shift[latest], self._last)
        corrected = angle.astype(np.float64) / UNITS - shift
        corrected += np.where(corrected < 0, 360, np.where(corrected >= 360, -360, 0))
        angle[...] = corrected
        # Just below 360 degrees, single precision rounds up to 360.
        angle[angle >= 360] = 0
        return float(shift[-1])

    def _remember(self, last: float) -> None:
        self._last = last


def samples_a_second(packets: bytes) -> float:
    """The rate of a stretch without a gap, as its angles and its speed tell; 0 where they do not.

    It is more exact than the vendor's figure: a real LD06 measured 4546 samples a second and not 4500.
    """
    rows = np.frombuffer(packets, PACKET)
    if len(rows) < 2:
        return 0.0
    starts = rows["start"].astype(np.int32)
    turned = int(((starts[1:] - starts[:-1]) % FULL_TURN).sum())
    hundredths_a_second = 100 * float(rows["speed"].mean())
    return SAMPLES * (len(rows) - 1) * hundredths_a_second / turned if turned else 0.0
