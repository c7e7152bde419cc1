"""What every decoder of this family hands back, made of arrays and of what `Rotation` found.

Packets of one format all have the same number of samples here, so everything that is counted in samples follows
from what is counted in packets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples, SteadySamples
from lidario.families.spans import Arcs

__all__ = ["Bytes", "Decoded", "Floats", "Ints", "Words", "decoded_samples", "decoded_steady"]

Bytes = NDArray[np.uint8]
Words = NDArray[np.uint16]
Floats = NDArray[np.float32]
Ints = NDArray[np.int32]


class Decoded(NamedTuple):
    """The arrays of `Samples`, shape (room + n,) each.

    Attributes:
        angle: Degrees.
        distance: Millimetres.
        intensity: None where the format carries none.
    """

    angle: Floats
    distance: Floats
    intensity: Bytes | None


def decoded_samples(arrays: Decoded, arcs: Arcs, full_turn: int, each: int, before_seam: int) -> Samples:
    """The samples of packets that follow each other.

    Args:
        arrays: All samples.
        arcs: How far the rotor turned during each packet, and what is missing.
        full_turn: 360 degrees in the unit of the arcs.
        each: Samples in a packet.
        before_seam: As in `Samples`.
    """
    packets = full_turn / arcs.typical if arcs.typical else 0.0
    gaps: list[tuple[int, int]] = []
    if arcs.missing is not None:
        behind = arcs.missing.nonzero()[0]
        gaps = list(zip(((behind + 1) * each).tolist(), (arcs.missing[behind] * each).tolist(), strict=True))
    count, broken = len(arcs.arc), arcs.missing is not None
    return Samples(
        arrays.angle,
        arrays.distance,
        arrays.intensity,
        before_seam,
        ends=range(each, count * each + 1, each),
        lost=arcs.lost if broken else 0,
        unbroken=arcs.unbroken if broken else count,
        lost_behind=arcs.lost_behind if broken else 0,
        revolution_packets=packets,
        revolution_samples=packets * each,
        certain=arcs.certain,
        gaps=gaps,
        first=arcs.first,
    )


def decoded_steady(
    arrays: Decoded,
    typical: Sequence[float],
    full_turn: int,
    packet_ends: Sequence[int],
    each: int,
    before_seam: Sequence[int],
    settle: Callable[[], None],
) -> SteadySamples:
    """The samples of several revolutions without a gap.

    Args:
        arrays: All samples.
        typical: The arc of an ordinary packet, of each revolution.
        full_turn: 360 degrees in the unit of the arcs.
        packet_ends: As in `SteadySamples`.
        each: Samples in a packet.
        before_seam: As in `SteadySamples`.
        settle: As in `SteadySamples`.
    """
    packets = [full_turn / arc for arc in typical]
    return SteadySamples(
        angle_deg=arrays.angle,
        distance_mm=arrays.distance,
        intensity=arrays.intensity,
        packet_ends=packet_ends,
        before_seam=before_seam,
        revolution_packets=packets,
        revolution_samples=[count * each for count in packets],
        settle=settle,
    )
