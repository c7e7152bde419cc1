"""Packets of one size that tell the angles of their first sample and of their last one.

The samples between lie at equal steps. Models that triangulate see with a lens beside the laser: what they measure
lies beside the beam, by an angle that depends on the distance. So neighbours can change places; revolutions are
divided by the beam, and corrected after that.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import (
    ArcDecoder,
    Floats,
    Output,
    at_equal_steps,
    in_turn,
    starts_and_arcs,
    write_degrees,
)
from lidario.families.spans import Arcs, Heads
from lidario.families.told import ToldWheel
from lidario.wire.events import Packets

__all__ = ["TwoAngleDecoder", "samples_a_second", "way_of"]

_UNEVEN: Final = 0.25
"""By so much the span of a packet may differ from that of most: 7.58 to 10.23 degrees in a recording of a real
LDROBOT LD06 whose spans are 8.71."""


class TwoAngleDecoder(ArcDecoder):
    """Decodes the packets of one stream.

    Args:
        packet: Layout of a packet, with the fields ``start``, ``end`` and ``samples``, and in those ``distance``.
        full_turn: 360 degrees in the unit of the angles.
        zero: What angles are counted from.
    """

    def __init__(self, packet: np.dtype[Any], full_turn: int, zero: int = 0) -> None:
        self._packet = packet
        self._each = int(packet["samples"].shape[0])
        self._zero = zero
        super().__init__(full_turn, ToldWheel(full_turn, self._each / 2))

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        rows = np.frombuffer(packets.data, self._packet)
        full, zero, after = self._full_turn, self._zero, None
        if following is not None:
            after = (int(np.frombuffer(following, self._packet, 1)["start"][0]) - zero) % full
        return Heads((rows["start"].astype(np.int32) - zero) % full, after, self._each, way_of(rows, full), rows)

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:
        self._read(heads.read["samples"], output)
        steps = self._each - 1
        at_equal_steps(starts_and_arcs(heads.first, arcs.arc), steps, output.angle)
        in_turn(output.angle, self._full_turn * steps, back=False)
        self._finish(output)

    def _read(self, measured: NDArray[Any], output: Output) -> None:
        """Write millimetres and intensities."""
        output.distance[...] = measured["distance"]
        output.intensity[...] = measured["intensity"]

    def _finish(self, output: Output) -> None:
        """Make degrees of the angles, which are counted in steps of a packet."""
        output.angle /= self._full_turn * (self._each - 1) / 360

    def _turn_back(self, angle: Floats, shift: NDArray[np.float64]) -> None:
        """Make degrees of the angles, which are counted in steps of a packet, less `shift` degrees; in place."""
        write_degrees(angle / np.float64(self._full_turn * (self._each - 1) / 360) - shift, angle)


def way_of(rows: NDArray[Any], full_turn: int) -> NDArray[np.int32]:
    """From the first sample of each packet to its last, in the unit of its angles."""
    way: NDArray[np.int32] = (rows["end"].astype(np.int32) - rows["start"].astype(np.int32)) % full_turn
    return way


def _even(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Which of them are about as usual: a check value that holds by chance lets any pass."""
    usual = float(np.median(values))
    return np.abs(values - usual) <= _UNEVEN * usual


def samples_a_second(rows: NDArray[Any], full_turn: int, turns_a_second: float) -> float:
    """The rate that the spans of packets and their speed tell; 0 where they do not. Packets may be missing.

    It is more exact than a vendor's figure: a real LDROBOT LD06 measured 4546 samples a second and not 4500.

    Args:
        rows: Packets.
        full_turn: 360 degrees in the unit of their angles.
        turns_a_second: What one unit of their field ``speed`` stands for.
    """
    if not len(rows):
        return 0.0
    way = way_of(rows, full_turn)
    even = _even(way) & _even(rows["speed"])
    turned = int(way[even].sum())
    if not turned:
        return 0.0
    steps = rows["samples"].shape[1] - 1
    return float(steps * full_turn * turns_a_second * rows["speed"][even].sum()) / turned
