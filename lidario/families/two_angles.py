"""Packets of one size that tell the angles of their first sample and of their last one.

The samples between lie at equal steps. No rotor turns by more than `MOST_TURNS` during a packet. A packet that says
so is damaged although its check value holds; its samples would lie all around.

Models that triangulate see with a lens beside the laser. What they measure lies beside the beam, by an angle that
depends on the distance. With this correction, neighbours can change places. So revolutions are divided by the angle
of the beam, and corrected after that.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Output, at_equal_steps, in_turn, write_degrees
from lidario.families.spans import Arcs, Heads, Ints
from lidario.families.told import ToldWheel
from lidario.wire.events import Packets
from lidario.wire.rows import LayoutFormat

_UNEVEN: Final = 0.25
"""Share by which the span of a packet may differ from the median: 7.58 to 10.23 degrees in a recording of a real
LDROBOT LD06 whose spans are 8.71."""
_SHORTEST: Final = 20
"""Angle units that packets must span on average to tell a rate: each of the two angles is rounded."""
MOST_TURNS: Final = 1 / 8
"""Largest span of a packet, in turns. An LDROBOT LD14 turns by 14 degrees at most, and a rotor is not even."""


class TwoAngleFormat(LayoutFormat):
    """The format of such packets: the layout has the fields ``start``, ``end``, ``speed`` and ``samples``."""

    def __init__(self) -> None:
        super().__init__()
        fields: Any = self.layout.fields
        self._places = fields["start"][1], fields["end"][1]  # offsets of the two angles in a packet

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        start, end = (int.from_bytes(data[at + place : at + place + 2], "little") for place in self._places)
        return bool(self._can_be(start, end)) and super().intact(data, at, size)

    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        rows, intact = np.frombuffer(data, self.layout, count, at), super()._intact_rows(data, at, count)
        intact &= self._can_be(rows["start"].astype(np.int32), rows["end"].astype(np.int32))
        return intact

    def _can_be(self, start: Any, end: Any) -> Any:
        """Whether a packet, or each of some, can have these angles."""
        first, last = start - self.zero, end - self.zero
        within = (first >= 0) & (first <= self.full_turn) & (last >= 0) & (last <= self.full_turn)
        return within & ((last - first) % self.full_turn <= MOST_TURNS * self.full_turn)

    @classmethod
    def way_of(cls, rows: NDArray[Any]) -> Ints:
        """Rotation from the first sample of each packet to its last, in the unit of its angles."""
        way: Ints = (rows["end"].astype(np.int32) - rows["start"].astype(np.int32)) % cls.full_turn
        return way

    @classmethod
    def samples_a_second(cls, packets: bytes) -> float:
        """Samples a second, by the spans and the speeds of packets; 0 if they do not tell. Packets may be missing.

        It is more exact than a vendor's figure: a real LDROBOT LD06 measured 4546 samples a second and not 4500.
        While a rotor stands or starts, its angles and the speed that it tells do not agree.
        """
        rows = np.frombuffer(packets, cls.layout)
        way = cls.way_of(rows)
        even = _even(way) & _even(rows["speed"])
        turned = int(way[even].sum())
        if 2 * np.count_nonzero(even) <= len(rows) or turned < _SHORTEST * np.count_nonzero(even):
            return 0.0
        steps = rows["samples"].shape[1] - 1
        turns_a_second = 1 / (60 * cls.an_rpm)
        return float(steps * cls.full_turn * turns_a_second * rows["speed"][even].sum()) / turned

    @classmethod
    def sample_us(cls, packets: bytes) -> float:
        """Microseconds of a sample, by the spans and the speeds of packets; 0 if they do not tell."""
        rate = cls.samples_a_second(packets)
        return 1e6 / rate if rate else 0.0


class TwoAngleDecoder(ArcDecoder):
    """Decodes the packets of one stream; `wire` is their format, whose samples have the field ``distance``."""

    def __init__(self, wire: type[TwoAngleFormat]) -> None:
        self._wire = wire
        self._each = int(wire.layout["samples"].shape[0])
        super().__init__(wire.full_turn, ToldWheel(wire.full_turn, self._each / 2))

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        wire, after = self._wire, None
        rows = np.frombuffer(packets.data, wire.layout)
        if following is not None:
            after = int(wire.angles_of(np.frombuffer(following, wire.layout, 1))[0])
        return Heads(wire.angles_of(rows), after, self._each, wire.way_of(rows), rows)

    def _reported_rpm(self, heads: Heads, begin: int, end: int) -> float:
        return float(heads.read["speed"][begin:end].mean()) / self._wire.an_rpm

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:
        self._read(heads.read["samples"], output)
        steps = self._each - 1
        at_equal_steps(heads.first, arcs.arc, steps, output.angle)
        in_turn(output.angle, self._full_turn * steps, back=False)
        shift, units = self._corrected(output), self._full_turn * steps / 360
        if shift is None:
            output.angle /= units
        else:
            write_degrees(output.angle / np.float64(units) - shift, output.angle)

    def _read(self, measured: NDArray[Any], output: Output) -> None:
        """Write millimetres and intensities."""
        output.distance[...] = measured["distance"]
        output.intensity[...] = measured["intensity"]

    def _corrected(self, output: Output) -> NDArray[np.float64] | None:  # noqa: ARG002
        """Degrees from each measured point to the beam; None if points lie on it. May also correct distances."""
        return None


def _even(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Which values are near the median: a damaged packet whose check value holds by chance may carry any."""
    usual = float(np.median(values))
    return np.abs(values - usual) <= _UNEVEN * usual
