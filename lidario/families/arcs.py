"""Packets that state where their first and their last sample lie: a decoder for every family that sends such.

Packets of many lidars have so many samples each, and the angles of the first and the last one; the others lie at
equal steps between. From one packet to the next the angle advances by one step. What the jump holds beyond that was
lost. A family derives its decoder from `ArcDecoder` and says where in a packet everything stands.

Angles are whole numbers in the family's own unit, so that nothing is rounded until degrees are made of them.
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import pairwise
from typing import ClassVar, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lidario.families.samples import Samples, SteadySamples
from lidario.wire.events import Packets

__all__ = ["ArcDecoder", "Floats", "Ints"]

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]

BACKWARD_DEG: Final = 2
"""By so much a packet may begin before the end of the one before, with nothing missing."""
UNSTEADY: Final = 0.5
"""Part of the usual way by which the way of a packet may differ: a real LD06 differs by 0.17 at most."""
REPEATED: Final = 1.5
"""Packets by which one that came twice goes back, and half as many again."""


class _Arcs(NamedTuple):
    """Where the rotor stood, in the unit of `full_turn`; arrays have the shape (packets,).

    Attributes:
        first: At the first sample of each packet.
        way: From there to its last sample.
        jumps: From there to the first sample of the next packet.
        rpm: Revolutions a minute, as the packet states it; None where it states none.
        full_turn: 360 degrees.
        samples: Samples in a packet.
    """

    first: Ints
    way: Ints
    jumps: Ints
    rpm: NDArray[np.float64] | None
    full_turn: int
    samples: int

    def part(self, begin: int, end: int) -> _Arcs:
        """Some of them."""
        rpm = None if self.rpm is None else self.rpm[begin:end]
        first, way, jumps = self.first[begin:end], self.way[begin:end], self.jumps[begin:end]
        return _Arcs(first, way, jumps, rpm, self.full_turn, self.samples)

    def missing(self) -> tuple[Ints, _Arcs]:
        """Packets missing behind each, empty where none is; and the arcs by which that was judged."""
        step = int(self.way.sum()) / ((self.samples - 1) * len(self.way))
        if not step or int(self.jumps.max()) < step * self.samples / 2:
            return np.zeros(0, np.int32), self
        arcs = self._likely()
        step = int(arcs.way.sum()) / ((self.samples - 1) * len(self.way))
        missing = np.rint((arcs.jumps / step - 1) / self.samples).astype(np.int32)
        return missing if missing.any() else missing[:0], arcs

    def _likely(self) -> _Arcs:
        """The arcs without what cannot be, to count by. No sample is moved: that must not depend on other packets.

        Where a check value has eight bits, it finds 255 of 256 damaged packets. In the other one the last angle may
        be wrong: then the packet seems to cover far more or far less than the others. And a line may deliver a
        packet twice.
        """
        usual = max(1, round(float(np.median(self.way))))
        way = np.where(np.abs(self.way - usual) > usual * UNSTEADY, np.int32(usual), self.way)
        jumps = (self.jumps + self.way - way) % self.full_turn
        jumps[jumps > self.full_turn - REPEATED * self.samples * usual / (self.samples - 1)] = 0
        return self._replace(way=way, jumps=jumps)

    def samples_a_turn(self, *, whole: bool) -> float:
        """By the mean step: from packet to packet where nothing is missing (`whole`), else within packets."""
        turned, steps = int(self.way.sum()), (self.samples - 1) * len(self.way)
        if whole:
            turned, steps = turned + int(self.jumps.sum()), self.samples * len(self.way)
        return self.full_turn * steps / turned if turned else 0.0

    def mean_rpm(self) -> float:
        """The mean of what the packets state; NaN where they state nothing."""
        return math.nan if self.rpm is None else float(self.rpm.mean())

    def before_seam(self, seam: int | None) -> int:
        """How many samples of the last packet were measured before the rotor passed `seam`."""
        way = int(self.way[-1])
        if seam is None or not way:
            return self.samples
        left = self.full_turn - (int(self.first[-1]) - seam) % self.full_turn
        return min(self.samples, -(-left * (self.samples - 1) // way))


class ArcDecoder(ABC):
    """Decodes the packets of one stream; obeys `Decoder`. Angles are the beam's, unless `_finish` changes them.

    Attributes:
        packet: How a packet lies in its bytes.
        samples: Samples in a packet.
        full_turn: 360 degrees in the unit of the angles.
    """

    packet: ClassVar[np.dtype[np.void]]
    samples: ClassVar[int]
    full_turn: ClassVar[int]

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        """As `Decoder.decode`."""
        rows = np.frombuffer(packets.data, self.packet)
        arcs = self._arcs(rows, following)
        missing, likely = arcs.missing()
        angle, distance, intensity, last = self._samples(rows, arcs, room)
        self._remember(last)
        gaps = missing.nonzero()[0]
        count = len(rows)
        a_turn = likely.samples_a_turn(whole=following is not None and not len(missing))
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            before_seam=(count - 1) * self.samples + arcs.before_seam(seam),
            ends=range(self.samples, count * self.samples + 1, self.samples),
            lost=int(missing.sum()),
            unbroken=int(gaps[0]) + 1 if len(gaps) else count,
            lost_behind=int(missing[-1]) if len(missing) else 0,
            revolution_packets=a_turn / self.samples,
            revolution_samples=a_turn,
            certain=a_turn > 0,
            reported_rpm=arcs.mean_rpm(),
            gaps=[((at + 1) * self.samples, int(missing[at]) * self.samples) for at in gaps.tolist()],
        )

    def tell_time(self, sample_ns: float) -> None:  # noqa: B027 - only formats without arcs need it
        """As `Decoder.tell_time`; packets tell how far the rotor turned."""

    def fork(self) -> Self:
        """As `Decoder.fork`."""
        return copy.copy(self)

    def decode_steady(
        self, packets: Packets, following: bytes, ends: Sequence[int], room: int = 0, seam: int | None = None
    ) -> SteadySamples | None:
        """As `Decoder.decode_steady`."""
        rows = np.frombuffer(packets.data, self.packet)
        arcs = self._arcs(rows, following)
        parts = [arcs.part(begin, end) for begin, end in pairwise((0, *ends))]
        judged = [part.missing() for part in parts]
        if any(len(missing) for missing, _ in judged):
            return None
        a_turn = [likely.samples_a_turn(whole=True) for _, likely in judged]
        if not all(a_turn):
            return None
        angle, distance, intensity, last = self._samples(rows, arcs, room)
        return SteadySamples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            packet_ends=[end * self.samples for end in ends],
            before_seam=[
                (end - 1) * self.samples + part.before_seam(seam) for end, part in zip(ends, parts, strict=True)
            ],
            revolution_packets=[each / self.samples for each in a_turn],
            revolution_samples=a_turn,
            settle=lambda: self._remember(last),
            reported_rpm=None if arcs.rpm is None else [part.mean_rpm() for part in parts],
        )

    def _arcs(self, rows: NDArray[np.void], following: bytes | None) -> _Arcs:
        full = self.full_turn
        first, last = self._angles(rows)
        first %= full
        way = (last - first) % full
        jumps = np.zeros_like(first)
        np.subtract(first[1:], (first + way)[:-1], out=jumps[:-1])
        if following is not None:
            jumps[-1] = int(self._angles(np.frombuffer(following, self.packet, 1))[0][0]) - first[-1] - way[-1]
        jumps %= full
        jumps[jumps > full - BACKWARD_DEG * full // 360] = 0
        return _Arcs(first, way, jumps, self._rpm(rows), full, self.samples)

    def _samples(
        self, rows: NDArray[np.void], arcs: _Arcs, room: int
    ) -> tuple[Floats, Floats, NDArray[np.uint8] | None, float]:
        """Degrees, millimetres and intensities behind `room` free places, and what to remember."""
        size, steps = self.samples, self.samples - 1
        total = room + len(rows) * size
        angle, distance = np.empty(total, np.float32), np.empty(total, np.float32)
        measured, strength = self._measured(rows)
        distance[room:].reshape(-1, size)[...] = measured
        intensity = None
        if strength is not None:
            intensity = np.empty(total, np.uint8)
            intensity[room:].reshape(-1, size)[...] = strength
        # Whole numbers below 2^24 until the last division, so that it alone rounds.
        beam = angle[room:].reshape(-1, size)
        np.multiply(arcs.way[:, None], np.arange(size, dtype=np.float32), out=beam, casting="unsafe")
        beam += (arcs.first * steps).astype(np.float32)[:, None]
        np.subtract(beam, self.full_turn * steps, out=beam, where=beam >= self.full_turn * steps)
        return angle, distance, intensity, self._finish(angle[room:], distance[room:])

    @abstractmethod
    def _angles(self, rows: NDArray[np.void]) -> tuple[Ints, Ints]:
        """Fresh arrays of the angles of the first and the last sample of each packet."""

    @abstractmethod
    def _measured(self, rows: NDArray[np.void]) -> tuple[NDArray[np.generic], NDArray[np.generic] | None]:
        """Distances in mm and intensities, shape (packets, samples); None where the format carries no intensity."""

    def _rpm(self, rows: NDArray[np.void]) -> NDArray[np.float64] | None:  # noqa: ARG002
        """The speed that each packet states, in revolutions a minute. Default: none."""
        return None

    def _finish(self, angle: Floats, distance: Floats) -> float:  # noqa: ARG002
        """Make degrees of the angles times the steps of a packet, in place; return what to remember. Here 0."""
        angle /= self.full_turn * (self.samples - 1) / 360
        return 0.0

    def _remember(self, last: float) -> None:  # noqa: B027 - most formats need not remember anything
        """Remember what `_finish` returned. Here nothing."""
