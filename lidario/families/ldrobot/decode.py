"""The packets of one stretch of stream, decoded at once into arrays, as `lidario.families.arcs` tells.

The vendor's SDK divides the span of a packet in whole hundredths of a degree; here it is exact.

Models that triangulate see with a lens beside the laser. Their angles are corrected by the distance: by
atan((0.11923 d - c) / (d + 5.9)), d in mm. So neighbours can change places; revolutions are divided by the
uncorrected angle.

* LD14 and LD14P: c is 18.975571, and the distance stays as it is (the vendor's ``sl_transform.cpp``). Where nothing
  came back, the angle has the correction before.
* LD08: c is 20.14, and the distance is that from the axis, the root of (d + 5.9)^2 + (0.11923 d - 20.14)^2
  (ROBOTIS, ``hls_lfcd_lds_driver``, ``transform.cpp``). Where nothing came back, the angle is that of the beam.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Decoded, Floats, in_turn
from lidario.families.ldrobot.formats import FULL_TURN, PACKET, SAMPLES
from lidario.families.spans import Arcs, Heads
from lidario.families.told import ToldWheel
from lidario.wire.events import Packets

__all__ = ["AxisDecoder", "PacketDecoder", "TriangleDecoder", "samples_a_second"]

STEPS: Final = SAMPLES - 1
"""From the first sample of a packet to the last."""
_UNEVEN: Final = 0.25
"""By so much the span of a packet may differ from that of most: 7.58 to 10.23 degrees in a recording of a real LD06
whose spans are 8.71."""


class PacketDecoder(ArcDecoder):
    """Decodes the packets of one stream; angles are those of the beam."""

    def __init__(self) -> None:
        super().__init__(FULL_TURN, ToldWheel(FULL_TURN, SAMPLES / 2))

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        rows = np.frombuffer(packets.data, PACKET)
        first = rows["start"].astype(np.int32) % FULL_TURN
        way = (rows["end"].astype(np.int32) - first) % FULL_TURN
        after = None if following is None else int(np.frombuffer(following, PACKET, 1)["start"][0]) % FULL_TURN
        return Heads(first, after, SAMPLES, way, rows)

    def _samples(
        self,
        packets: Packets,  # noqa: ARG002
        heads: Heads,
        arcs: Arcs,
        ends: Sequence[int],
        room: int,
    ) -> Decoded:
        size = room + ends[-1]
        angle, distance = np.empty(size, np.float32), np.empty(size, np.float32)
        intensity = np.empty(size, np.uint8)
        measured = heads.read["samples"]
        distance[room:].reshape(-1, SAMPLES)[...] = measured["distance"]
        intensity[room:].reshape(-1, SAMPLES)[...] = measured["intensity"]
        # Whole numbers below 2^24 until the last division, so that it alone rounds.
        beam = angle[room:].reshape(-1, SAMPLES)
        np.multiply(arcs.arc[:, None], np.arange(SAMPLES, dtype=np.float32), out=beam, casting="unsafe")
        beam += (heads.first * STEPS).astype(np.float32)[:, None]
        in_turn(beam, FULL_TURN * STEPS, back=False)
        return Decoded(angle, distance, intensity, self._finish(angle[room:], distance[room:]))

    def _reported_rpm(self, heads: Heads, begin: int, end: int) -> float:
        return float(heads.read["speed"][begin:end].mean()) / 6

    def _finish(self, angle: Floats, distance: Floats) -> float:  # noqa: ARG002
        """Make degrees of the angles times the steps of a packet, in place; return what to remember."""
        angle /= FULL_TURN * STEPS / 360
        return 0.0


class TriangleDecoder(PacketDecoder):
    """Decodes the packets of one stream of an LD14 or LD14P."""

    def __init__(self) -> None:
        super().__init__()
        self._last = 0.0

    def _finish(self, angle: Floats, distance: Floats) -> float:
        d = distance.astype(np.float64)
        shift = np.degrees(np.arctan((0.11923 * d - 18.975571) / (d + 5.9)))
        # Where nothing came back, the correction of the sample before.
        latest = np.maximum.accumulate(np.where(d > 0, np.arange(len(d)), -1))
        shift = np.where(latest >= 0, shift[latest], self._last)
        _turn_back(angle, shift)
        return float(shift[-1])

    def _remember(self, heads: Heads, last: float) -> None:  # noqa: ARG002
        self._last = last


class AxisDecoder(PacketDecoder):
    """Decodes the packets of one stream of an LD08."""

    def _finish(self, angle: Floats, distance: Floats) -> float:
        d = distance.astype(np.float64)
        ahead, aside = d + 5.9, 0.11923 * d - 20.14
        _turn_back(angle, np.where(d > 0, np.degrees(np.arctan(aside / ahead)), 0.0))
        np.copyto(distance, np.hypot(ahead, aside), where=d > 0, casting="same_kind")
        return 0.0


def _turn_back(angle: Floats, shift: NDArray[np.float64]) -> None:
    """Make degrees of the angles times the steps of a packet, less `shift` degrees; in place."""
    corrected = angle.astype(np.float64) / (100.0 * STEPS) - shift
    corrected += np.where(corrected < 0, 360, np.where(corrected >= 360, -360, 0))
    angle[...] = corrected
    # Just below 360 degrees, single precision rounds up to 360.
    angle[angle >= 360] = 0


def samples_a_second(packets: bytes) -> float:
    """The rate that the spans of packets and their speed tell; 0 where they do not. Packets may be missing.

    It is more exact than the vendor's figure: a real LD06 measured 4546 samples a second and not 4500.
    """
    rows = np.frombuffer(packets, PACKET)
    if not len(rows):
        return 0.0
    way = (rows["end"].astype(np.int32) - rows["start"].astype(np.int32)) % FULL_TURN
    usual = float(np.median(way))
    even = np.abs(way - usual) <= _UNEVEN * usual
    turned = int(way[even].sum())
    return STEPS * 100.0 * float(rows["speed"][even].sum()) / turned if turned else 0.0
