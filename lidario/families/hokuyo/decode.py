"""Blocks to arrays. One block is one whole scan, so nothing lies across a seam and nothing is missing inside.

The angle of step n is (n - AFRT) * 360 / ARES counter-clockwise (urg_library 1.2.7, ``urg_utils.c``); ours are
clockwise, so they fall. A distance below DMIN is the code of an error, one beyond DMAX no return.
"""

from itertools import pairwise
from typing import Final

import numpy as np

from lidario.families.arcs import write_degrees
from lidario.families.base import DecodedRevolution, Decoder, Samples
from lidario.families.hokuyo.formats import DistanceFormat, characters, range_of, values
from lidario.families.hokuyo.geometry import Geometry
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets

STRENGTH_SHIFT: Final = 4
"""Intensities have up to 18 bits on the wire, of which devices use about 12: 4095 becomes 255, and so does more."""


class BlockDecoder(Decoder):
    """Decodes the blocks of one stream. A scan needs no other, so it remembers none and decodes none together."""

    def __init__(self, wire: type[DistanceFormat], geometry: Geometry) -> None:
        self._numbers = wire.characters // 3
        self._geometry = geometry

    def decode(
        self,
        packets: Packets,
        following: bytes | None,  # noqa: ARG002
        room: int = 0,
        seam: int | None = None,  # noqa: ARG002
    ) -> Samples:
        offsets = packet_offsets(packets.blocks)
        blocks = [packets.data[at:end] for at, end in pairwise(offsets)]
        steps = [np.arange(first, last + 1) for first, last in map(range_of, blocks)]
        table = values(np.concatenate([characters(each) for each in blocks]), 3).reshape(-1, self._numbers)
        ends = np.cumsum([len(each) for each in steps]).tolist()
        angle, distance = np.empty(room + ends[-1], np.float32), np.empty(room + ends[-1], np.float32)
        of, far = self._geometry, table[:, 0]
        write_degrees((of.front - np.concatenate(steps)) % of.turn * 360.0 / of.turn, angle[room:])
        distance[room:] = np.where((of.nearest <= far) & (far <= of.farthest), far, 0)
        strength = None
        if self._numbers > 1:
            strength = np.empty(len(angle), np.uint8)
            strength[room:] = np.minimum(table[:, 1] >> STRENGTH_SHIFT, 255)
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=strength,
            ends=ends,
            revolutions=[DecodedRevolution(ends[-1], packets=1.0, samples=float(of.turn))],
            lost=0,
            unbroken=len(blocks),
        )
