"""The packets of one stretch of stream, decoded at once into arrays.

A packet states the angles of its first and its last sample, and the others lie at equal steps between (LD06
development manual). The vendor's SDK divides the span in whole hundredths of a degree; here it is exact.

Models that triangulate see with a lens beside the laser. Their angles are corrected by the distance (the vendor's
``sl_transform.cpp``): by atan((0.11923 d - 18.975571) / (d + 5.9)), d in mm, and where nothing came back by the
correction before. So neighbours can change places; the revolution is cut by the uncorrected angle.

Lost packets: from one packet to the next the angle advances by one step. What the jump holds beyond that was lost.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples, SteadySamples
from lidario.families.ldrobot.formats import FULL_TURN, PACKET, SAMPLES
from lidario.wire.events import Packets

__all__ = ["PacketDecoder", "TriangleDecoder", "samples_a_second"]

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]

STEPS: Final = SAMPLES - 1
UNITS: Final = 100.0 * STEPS
"""In a degree, where every sample of a packet stands at a whole number."""
BACKWARD: Final = 200
"""Hundredths of a degree by which a packet may begin before the end of the one before, with nothing missing."""
UNSTEADY: Final = 0.5
"""Part of the usual way by which the way of a packet may differ: a real LD06 differs by 0.17 at most."""
REPEATED: Final = 1.5 * SAMPLES
"""Steps by which a packet that came twice goes back, and half as many again."""
_ORDER: Final = np.arange(SAMPLES, dtype=np.float32)


class _Arcs(NamedTuple):
    """Where the rotor stood, shape (packets,) each, hundredths of a degree.

    Attributes:
        first: At the first sample of each packet.
        way: From there to its last sample.
        jumps: From there to the first sample of the next packet.
        speeds: Degrees a second, as the packet states it.
    """

    first: Ints
    way: Ints
    jumps: Ints
    speeds: Ints

    @classmethod
    def of(cls, packets: NDArray[np.void], following: bytes | None) -> _Arcs:
        """Those of so many packets."""
        first = packets["start"].astype(np.int32) % FULL_TURN
        way = (packets["end"] - first) % FULL_TURN
        jumps = np.zeros_like(first)
        np.subtract(first[1:], (first + way)[:-1], out=jumps[:-1])
        if following is not None:
            jumps[-1] = int.from_bytes(following[4:6], "little") - first[-1] - way[-1]
        jumps %= FULL_TURN
        jumps[jumps > FULL_TURN - BACKWARD] = 0
        return cls(first, way, jumps, packets["speed"].astype(np.int32))

    def part(self, begin: int, end: int) -> _Arcs:
        """Some of them."""
        return _Arcs(*(each[begin:end] for each in self))

    def missing(self) -> Ints:
        """Packets missing behind each; empty where none is."""
        step = int(self.way.sum()) / (STEPS * len(self.way))
        if not step or int(self.jumps.max()) < step * SAMPLES / 2:
            return np.zeros(0, np.int32)
        step = self._correct()
        missing = np.rint((self.jumps / step - 1) / SAMPLES).astype(np.int32)
        return missing if missing.any() else missing[:0]

    def _correct(self) -> float:
        """Correct what cannot be, in place; return the step of a sample.

        The CRC finds 255 of 256 damaged packets. In the other one the last angle may be wrong: then the packet
        seems to cover far more or far less than the others. And a line may deliver a packet twice.
        """
        usual = float(np.median(self.way))
        wrong = np.abs(self.way - usual) > usual * UNSTEADY
        self.jumps[wrong] += self.way[wrong] - round(usual)
        self.jumps[wrong] %= FULL_TURN
        self.way[wrong] = round(usual)
        step = usual / STEPS
        self.jumps[self.jumps > FULL_TURN - REPEATED * step] = 0
        return step

    def samples_a_turn(self, *, whole: bool) -> float:
        """By the mean step: from packet to packet where nothing is missing (`whole`), else within packets."""
        turned, steps = int(self.way.sum()), STEPS * len(self.way)
        if whole:
            turned, steps = turned + int(self.jumps.sum()), SAMPLES * len(self.way)
        return FULL_TURN * steps / turned if turned else 0.0

    def rpm(self) -> float:
        """The mean of what the packets state."""
        return int(self.speeds.sum()) / len(self.speeds) / 6

    def before_seam(self, seam: int | None) -> int:
        """How many samples of the last packet were measured before the rotor passed `seam`."""
        way = int(self.way[-1])
        if seam is None or not way:
            return SAMPLES
        left = FULL_TURN - (int(self.first[-1]) - seam) % FULL_TURN
        return min(SAMPLES, -(-left * STEPS // way))


class PacketDecoder:
    """Decodes the packets of one stream; angles are those of the beam."""

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        """As `Decoder.decode`."""
        rows = np.frombuffer(packets.data, PACKET)
        arcs = _Arcs.of(rows, following)
        # First: it corrects angles.
        missing = arcs.missing()
        angle, distance, intensity, last = self._samples(rows, arcs, room)
        self._remember(last)
        gaps = missing.nonzero()[0]
        count = len(rows)
        a_turn = arcs.samples_a_turn(whole=following is not None and not len(missing))
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            before_seam=(count - 1) * SAMPLES + arcs.before_seam(seam),
            ends=range(SAMPLES, count * SAMPLES + 1, SAMPLES),
            lost=int(missing.sum()),
            unbroken=int(gaps[0]) + 1 if len(gaps) else count,
            lost_behind=int(missing[-1]) if len(missing) else 0,
            revolution_packets=a_turn / SAMPLES,
            revolution_samples=a_turn,
            certain=a_turn > 0,
            reported_rpm=arcs.rpm(),
            gaps=list(zip(((gaps + 1) * SAMPLES).tolist(), (missing[gaps] * SAMPLES).tolist(), strict=True)),
        )

    def fork(self) -> Self:
        """As `Decoder.fork`."""
        return copy.copy(self)

    def decode_steady(
        self, packets: Packets, following: bytes, ends: Sequence[int], room: int = 0, seam: int | None = None
    ) -> SteadySamples | None:
        """As `Decoder.decode_steady`."""
        rows = np.frombuffer(packets.data, PACKET)
        arcs = _Arcs.of(rows, following)
        parts = [arcs.part(begin, end) for begin, end in pairwise((0, *ends))]
        if any(len(part.missing()) for part in parts):
            return None
        a_turn = [part.samples_a_turn(whole=True) for part in parts]
        if not all(a_turn):
            return None
        angle, distance, intensity, last = self._samples(rows, arcs, room)
        return SteadySamples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            packet_ends=[end * SAMPLES for end in ends],
            before_seam=[
                (end - 1) * SAMPLES + part.before_seam(seam) for end, part in zip(ends, parts, strict=True)
            ],
            revolution_packets=[each / SAMPLES for each in a_turn],
            revolution_samples=a_turn,
            settle=lambda: self._remember(last),
            reported_rpm=[part.rpm() for part in parts],
        )

    def _samples(
        self, rows: NDArray[np.void], arcs: _Arcs, room: int
    ) -> tuple[Floats, Floats, NDArray[np.uint8], float]:
        """Degrees, millimetres and intensities behind `room` free places, and what to remember."""
        total = room + len(rows) * SAMPLES
        angle, distance = np.empty(total, np.float32), np.empty(total, np.float32)
        intensity = np.empty(total, np.uint8)
        measured = rows["samples"]
        distance[room:].reshape(-1, SAMPLES)[...] = measured["distance"]
        intensity[room:].reshape(-1, SAMPLES)[...] = measured["intensity"]
        # Whole numbers below 2^24 until the last division, so that it alone rounds.
        beam = angle[room:].reshape(-1, SAMPLES)
        np.multiply(arcs.way[:, None], _ORDER, out=beam, casting="unsafe")
        beam += (arcs.first * STEPS).astype(np.float32)[:, None]
        np.subtract(beam, FULL_TURN * STEPS, out=beam, where=beam >= FULL_TURN * STEPS)
        return angle, distance, intensity, self._finish(angle[room:], distance[room:])

    def _finish(self, angle: Floats, distance: Floats) -> float:  # noqa: ARG002
        """Make degrees of 1100ths, in place; return what to remember, here nothing."""
        angle /= UNITS
        return 0.0

    def _remember(self, last: float) -> None:
        """Remember what `_finish` returned. Here nothing."""


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
        angle[...] = np.where(
            corrected < 0, corrected + 360, np.where(corrected >= 360, corrected - 360, corrected)
        )
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
