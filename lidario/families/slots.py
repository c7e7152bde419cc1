"""Decodes packets that divide a revolution into equal slots, and finds what is missing: each packet tells its slot.

Such a device measures at angles and not at times, so its packets cover the same angle at any speed. So nothing has
to be learned about the rotor. If the next packet is ahead by more than one slot, the packets between were lost.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Output
from lidario.families.samples import Samples
from lidario.families.spans import Arcs, Heads, Ints, Turning, spans_between
from lidario.wire.events import Arrival, Packets
from lidario.wire.rows import LayoutFormat

FULL_TURN: Final = 360  # 360 degrees in degrees
HEAD: Final = 0xFA
FIRST: Final = 0xA0
"""Number of the first packet of a revolution, in the second byte; the same in all known devices."""


def sample_us_at(rpm: float) -> float:
    """Microseconds of a sample that covers a degree; 0 if the rotor stands."""
    return 60e6 / (rpm * FULL_TURN) if rpm else 0.0


@dataclass(frozen=True, slots=True)
class SlotWheel(Turning):
    """Follows the rotor by packets of equal slots. It remembers nothing.

    It does not follow several revolutions at once: the time of a sample differs from one to the next.
    """

    full_turn: int  # 360 degrees in the unit of the headings
    slots: int  # packets of a revolution

    def follow(self, heads: Heads, arrivals: Sequence[Arrival] = ()) -> Arcs:  # noqa: ARG002
        spans, _, greatest, _ = spans_between(heads, self.full_turn, 0)
        count, slot = len(spans), self.full_turn // self.slots
        arcs = np.full(count, slot, np.int32)
        step = self.full_turn / (self.slots * heads.samples / count)
        if greatest <= slot:
            return Arcs(arcs, None, step, certain=True)
        missing = np.maximum(np.rint(spans / slot) - 1, 0) * heads.counts
        return Arcs(arcs, missing.astype(np.intp), step, certain=True)


class SlotDecoder(ArcDecoder):
    """Decodes packets of equal slots. Each packet tells the speed, which gives the time of a sample.

    Speeds are rounded, and the number of samples in a packet may change by one from slot to slot. So the mean over
    the packets of a whole revolution counts; for a part of a revolution, with the packets before it. The decoder
    remembers nothing else.
    """

    def __init__(self, full_turn: int, slots: int) -> None:
        super().__init__(full_turn, SlotWheel(full_turn, slots))
        self._slots = slots
        self._speeds = self._counts = np.empty(0)

    @abstractmethod
    def _rpm(self, heads: Heads) -> NDArray[np.float64]:
        """The speed that each packet tells, revolutions a minute."""

    def _reported_rpm(self, heads: Heads, begin: int, end: int) -> float:
        return float(self._rpm(heads)[begin:end].mean())

    def _samples(
        self, packets: Packets, heads: Heads, arcs: Arcs, ends: Sequence[int], room: int, seam: int | None
    ) -> Samples:
        samples, count = super()._samples(packets, heads, arcs, ends, room, seam), len(heads.first)
        self._speeds = np.concatenate((self._speeds, self._rpm(heads)))[-max(count, self._slots) :]
        self._counts = np.concatenate((self._counts, np.broadcast_to(heads.counts, count)))[-len(self._speeds) :]
        turn = float(self._speeds.mean()) * float(self._counts.mean()) * self._slots
        samples.sample_ns = 60e9 / turn if turn else 0.0
        return samples


class DegreeFormat(LayoutFormat):
    """Packets whose samples stand at whole degrees, counted as the rotor turns.

    Their layout has the fields ``number``, behind `HEAD`, and ``speed``. Only the speed gives the time of a sample:
    the time in which the rotor turns by a degree.
    """

    full_turn = FULL_TURN

    @classmethod
    def angles_of(cls, rows: NDArray[Any]) -> Ints:
        angles: Ints = (rows["number"].astype(np.int32) - FIRST) * rows["samples"].shape[1]
        return angles

    @classmethod
    @abstractmethod
    def returns_of(cls, rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Millimetres, 0 where nothing came back, and intensities up to 255; shape (packets, samples) each."""

    @classmethod
    def speeds_of(cls, rows: NDArray[Any]) -> NDArray[np.float64]:
        """The speed that each packet tells, revolutions a minute."""
        speeds: NDArray[np.float64] = rows["speed"] / np.float64(cls.an_rpm)
        return speeds

    @classmethod
    def rpm_of(cls, packets: bytes) -> float:
        """The speed that most packets tell, revolutions a minute: the median."""
        return float(np.median(np.frombuffer(packets, cls.layout)["speed"])) / cls.an_rpm

    @classmethod
    def sample_us(cls, packets: bytes) -> float:
        """Microseconds of a sample, by the speed that packets tell; 0 if the rotor stands."""
        return sample_us_at(cls.rpm_of(packets))

    def told_sample_ns(self, packets: Packets) -> NDArray[np.float64]:
        speeds = self.speeds_of(np.frombuffer(packets.data, self.layout))
        return 60e9 / (np.maximum(speeds, 1.0) * FULL_TURN)


class DegreeDecoder(SlotDecoder):
    """Decodes the packets of a `DegreeFormat`; `wire` tells what they hold and which way the rotor turns."""

    def __init__(self, wire: type[DegreeFormat]) -> None:
        self._wire = wire
        self._each = int(wire.layout["samples"].shape[0])
        super().__init__(FULL_TURN, FULL_TURN // self._each)

    def _rpm(self, heads: Heads) -> NDArray[np.float64]:
        return self._wire.speeds_of(heads.read)

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        rows = np.frombuffer(packets.data, self._wire.layout)
        after = None if following is None else (following[1] - FIRST) * self._each
        return Heads(self._wire.angles_of(rows), after, self._each, None, rows)

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:  # noqa: ARG002
        output.distance[...], output.intensity[...] = self._wire.returns_of(heads.read)
        turned = heads.first[:, None] + np.arange(self._each)
        output.angle[...] = turned if self._wire.field_deg > 0 else -turned % FULL_TURN
