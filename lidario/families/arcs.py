"""The base of all decoders: during each packet the rotor turns by an arc.

A family derives its decoder from `ArcDecoder` and says where in a packet everything stands. A `Turning` finds how
far the rotor turned and what is missing. Angles are whole numbers in the unit of the format, so that nothing is
rounded until they are converted to degrees.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from lidario.families.samples import DecodedRevolution, Samples
from lidario.families.spans import Arc, Arcs, Heads, Ints, Turning
from lidario.wire.copies import copy_of
from lidario.wire.events import Packets

Floats = NDArray[np.float32]
_NO_INTENSITY = np.empty(0, np.uint8)


@dataclass(slots=True, eq=False)
class Output:
    """Where samples are written: arrays of shape (packets, samples) if all packets have as many, else flat."""

    angle: Floats  # degrees
    distance: Floats  # millimetres
    intensity: NDArray[np.uint8]  # not used if the format carries none


class ArcDecoder(ABC):
    """Decodes the packets of one stream, with `turning` to follow the rotor; a `Decoder`."""

    has_intensity: bool = True  # whether the format carries intensities

    def __init__(self, full_turn: int, turning: Turning) -> None:
        self._full_turn = full_turn
        self._turning = turning

    def tell_time(self, sample_ns: float, *, passes: bool = True) -> None:
        self._turning.tell_time(sample_ns, passes=passes)

    def fork(self) -> Self:
        twin = copy_of(self)
        twin._turning = self._turning.copy()  # noqa: SLF001 - its own
        return twin

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        heads = self._heads(packets, following)
        arcs = self._turning.follow(heads, packets.arrivals)
        return self._samples(packets, heads, arcs, (len(heads.first),), room, seam)

    def is_whole(self, packets: Packets, following: bytes) -> bool:
        heads = self._heads(packets, following)
        return self._turning.copy().follow_several(heads, (len(heads.first),), packets.arrivals) is not None

    def decode_several(
        self, packets: Packets, following: bytes, ends: Sequence[int], room: int, seam: int | None
    ) -> Samples | None:
        heads = self._heads(packets, following)
        arcs = self._turning.follow_several(heads, ends, packets.arrivals)
        return None if arcs is None else self._samples(packets, heads, arcs, ends, room, seam)

    def _samples(
        self, packets: Packets, heads: Heads, arcs: Arcs, ends: Sequence[int], room: int, seam: int | None
    ) -> Samples:
        if packets.cut:
            self._turning.doubt_time()
        sample_ends, count = self._ends(heads), len(heads.first)
        gaps, lost = ([], []) if arcs.skipped is None else self._gaps(heads, arcs, arcs.skipped)
        size = room + sample_ends[-1]
        angle, distance, intensity = np.empty(size, np.float32), np.empty(size, np.float32), None
        shape = (-1, heads.counts) if isinstance(heads.counts, int) else (-1,)
        output = Output(angle[room:].reshape(shape), distance[room:].reshape(shape), _NO_INTENSITY)
        if self.has_intensity:
            intensity = np.empty(size, np.uint8)
            output.intensity = intensity[room:].reshape(shape)
        self._write(heads, arcs, output)
        revolutions, begin = list[DecodedRevolution](), 0
        for end, step in zip(ends, arcs.steps or (arcs.step,), strict=True):
            behind = 0 if seam is None else self._behind_seam(heads, arcs, end - 1, seam)
            turn = self._full_turn / step if step else 0.0
            a_turn = self._revolution_packets(heads, turn, begin, end) if turn else 0.0
            rpm = self._reported_rpm(heads, begin, end)
            revolutions.append(DecodedRevolution(sample_ends[end - 1] - behind, a_turn, turn, rpm))
            begin = end
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            ends=sample_ends,
            revolutions=revolutions,
            lost=sum(lost),
            unbroken=gaps[0][0] + 1 if gaps else count,
            lost_behind=lost[-1] if gaps and gaps[-1][0] == count - 1 else 0,
            certain=arcs.certain,
            gaps=[(sample_ends[at], skipped) for at, skipped in gaps] if gaps else (),
            revoked=arcs.revoked,
            fits=arcs.fits,
        )

    # ------------------------------------------------------------------------------------- what a format must tell

    @abstractmethod
    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        """The angles of the packets and of the packet behind them."""

    @abstractmethod
    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:
        """Write degrees, millimetres and intensities of all samples; remember what the next packets need."""

    # --------------------------------------------------------------------------------- what a format may tell else

    def _lost(self, heads: Heads, at: int, skipped: int, step: float) -> int:  # noqa: ARG002
        """How many packets are missing behind packet `at`, if `skipped` samples are; `step` as in `Arcs`."""
        return round(skipped / heads.count_of(at))

    def _revolution_packets(self, heads: Heads, samples: float, begin: int, end: int) -> float:  # noqa: ARG002
        """How many packets a revolution of so many samples has, by the packets from `begin` to before `end`."""
        assert isinstance(heads.counts, int)
        return samples / heads.counts

    def _reported_rpm(self, heads: Heads, begin: int, end: int) -> float:  # noqa: ARG002
        """The speed that packets from `begin` to before `end` state, revolutions a minute. Default: none, NaN."""
        return math.nan

    def _behind_seam(self, heads: Heads, arcs: Arcs, at: int, seam: int) -> int:
        """How many samples of packet `at` were measured after the rotor had passed `seam`."""
        counts = heads.count_of(at)
        # The way of a packet ends at its last sample; an arc ends one step farther.
        steps, arc = counts - (heads.way is not None), float(arcs.arc[at])
        left = self._full_turn - (int(heads.first[at]) - seam) % self._full_turn
        return max(0, counts - math.ceil(left * steps / arc)) if arc > 0 else 0

    @staticmethod
    def _ends(heads: Heads) -> Sequence[int]:
        """Samples up to the end of each packet."""
        counts = heads.counts
        if isinstance(counts, int):
            return range(counts, counts * len(heads.first) + 1, counts)
        ends: list[int] = np.add.accumulate(counts).tolist()
        return ends

    def _gaps(self, heads: Heads, arcs: Arcs, skipped: NDArray[np.intp]) -> tuple[list[tuple[int, int]], list[int]]:
        """Pairs of a packet and how many samples are missing behind it; and how many packets are, for each pair."""
        found = [
            (at, each, self._lost(heads, at, each, arcs.step))
            for at, each in zip(skipped.nonzero()[0].tolist(), skipped[skipped != 0].tolist(), strict=True)
        ]
        return [(at, each) for at, each, lost in found if lost], [lost for _, _, lost in found if lost]


def at_equal_steps(first: Ints, arc: Arc, steps: int, into: Floats) -> None:
    """Write the angles of samples that lie at equal steps from the first sample of their packet.

    An arc consists of `steps` steps. The angles are written in units of which a heading unit has `steps`. In this
    unit they are whole numbers if arcs are, and below 2^24, which single precision holds exactly. So only the last
    division, which makes degrees of them, rounds. `into` has the shape (packets, samples).
    """
    each = np.empty((len(first), 2), np.float32)
    each[:, 0], each[:, 1] = first, arc
    each.dot(_weights(into.shape[1], steps), out=into)


@cache
def _weights(samples: int, steps: int) -> NDArray[np.float32]:
    """The weights of the first angle of a packet, and of its arc, in the angle of each of its samples."""
    order = np.arange(samples, dtype=np.float32)
    return np.stack((np.full_like(order, steps), order))


def in_turn(angles: Floats, full_turn: int, *, back: bool) -> None:
    """Bring angles that are at most 360 degrees outside into [0, full_turn), in place.

    Comparing all angles of a revolution takes half the time of finding the few packets that lie across 0. Angles
    may be below 0 only with `back`.
    """
    if back:
        # This takes half the time of two masked operations. An angle below 360 degrees, divided by 360 degrees, is
        # never rounded up to 1.
        turns = angles / full_turn
        np.floor(turns, out=turns)
        turns *= full_turn
        angles -= turns
        if np.maximum.reduce(angles, axis=None) < full_turn:
            return
        # A tiny negative angle plus 360 degrees was rounded up to 360.
    np.subtract(angles, full_turn, out=angles, where=angles >= full_turn)


def write_degrees(degrees: NDArray[np.floating[Any]], into: Floats) -> None:
    """Write angles that are at most 360 degrees outside of [0, 360), in single precision."""
    into[...] = degrees + np.where(degrees < 0, 360.0, np.where(degrees >= 360.0, -360.0, 0.0))
    # Just below 360 degrees, single precision rounds up to 360.
    into[into >= 360.0] = 0.0
