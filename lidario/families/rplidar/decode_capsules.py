"""The decoders of the four capsule formats, 0x82, 0x84, 0x85 and 0x86.

A capsule states where it begins; its samples lie at equal steps from there, up to where the next one begins. So the
angles of a whole stretch are one product of two small matrices. What is inside the cabins stands in `cabins`.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples, SteadySamples
from lidario.families.rplidar.cabins import (
    express_cabins,
    near_range_corrections,
    ultra_cabins,
    ultra_dense_cabins,
)
from lidario.families.rplidar.decoded import (
    Bytes,
    Decoded,
    Floats,
    Ints,
    Words,
    decoded_samples,
    decoded_steady,
)
from lidario.families.rplidar.formats import (
    ANGLE_MASK,
    FULL_TURN_Q6,
    CapsuleFormat,
    DenseFormat,
    ExpressFormat,
    UltraDenseFormat,
    UltraFormat,
)
from lidario.families.spans import Arc
from lidario.families.wheel import Wheel
from lidario.wire.events import Packets

__all__ = ["CapsuleDecoder", "DenseDecoder", "ExpressDecoder", "UltraDecoder", "UltraDenseDecoder", "in_turn"]


def in_turn(angles: Floats, full_turn: int, *, back: bool) -> None:
    """Bring angles that are at most 360 degrees outside into [0, full_turn), in place.

    To compare all of a revolution takes half the time of finding the few packets that lie across 0.

    Args:
        angles: Whole numbers, or fractions, of which a revolution has `full_turn`.
        full_turn: 360 degrees.
        back: Whether some may be below 0.
    """
    if back:
        # Half the time of two masked operations. An angle below 360 degrees, divided by 360 degrees, is never
        # rounded up to 1.
        turns = angles / full_turn
        np.floor(turns, out=turns)
        turns *= full_turn
        angles -= turns
        if np.maximum.reduce(angles, axis=None) < full_turn:
            return
        # A tiny negative angle plus 360 degrees does round up.
    np.subtract(angles, full_turn, out=angles, where=angles >= full_turn)


class Capsules(NamedTuple):
    """Packets of a capsule format, as words.

    Attributes:
        words: (packets, words of one).
        after: The packet behind them, if known.
        missing: Packets missing behind each; None when none is.
    """

    words: Words
    after: Words | None
    missing: NDArray[np.intp] | None


class CapsuleDecoder(ABC):
    """What the four capsule formats have in common: samples at equal steps from the start angle.

    While it works, angles are counted in units of which a degree has 64 for each sample of a packet: whole
    numbers, as long as no arc had to be guessed.

    Attributes:
        size: Bytes of one packet.
        start_at: Offset of the start angle.
        samples: Samples in one packet.
        corrected: Whether samples have corrections, which may take an angle back over 0.
    """

    size: ClassVar[int]
    start_at: ClassVar[int] = CapsuleFormat.start_at
    samples: ClassVar[int]
    corrected: ClassVar[bool] = False

    def __init__(self) -> None:
        self._wheel = Wheel(FULL_TURN_Q6)
        self._units = 64.0 * self.samples
        order = np.arange(self.samples, dtype=np.float32)
        self._steps = np.stack((np.full_like(order, self.samples), order))
        """What a start angle and an arc contribute to each sample of a packet."""

    def tell_time(self, sample_ns: float) -> None:
        """As `Decoder.tell_time`."""
        self._wheel.packet_ns = self.samples * sample_ns

    def fork(self) -> Self:
        """As `Decoder.fork`."""
        twin = copy.copy(self)
        twin._wheel = self._wheel.copy()  # noqa: SLF001 - its own
        return twin

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        """As `Decoder.decode`."""
        words, after, starts, next_start = self._read(packets, following)
        arcs = self._wheel.follow(starts, next_start, packets.arrivals)
        capsules = Capsules(words, after, arcs.missing)
        decoded = self._samples_of(capsules, starts, arcs.arc, room)
        self._remember(capsules, decoded.distance)
        before_seam = len(starts) * self.samples
        if seam is not None:
            before_seam = self._before_seam(len(starts), int(starts[-1]), float(arcs.arc[-1]), seam)
        return decoded_samples(decoded, arcs, FULL_TURN_Q6, self.samples, before_seam)

    def decode_steady(
        self, packets: Packets, following: bytes, ends: Sequence[int], room: int = 0, seam: int | None = None
    ) -> SteadySamples | None:
        """As `Decoder.decode_steady`."""
        words, after, starts, next_start = self._read(packets, following)
        arcs = None if next_start is None else self._wheel.steady(starts, next_start, ends)
        if arcs is None:
            return None
        capsules = Capsules(words, after, None)
        decoded = self._samples_of(capsules, starts, arcs.arc, room)
        before_seam = packet_ends = [end * self.samples for end in ends]
        if seam is not None:
            last = np.array(ends) - 1
            lasts = zip(ends, starts[last].tolist(), arcs.arc[last].tolist(), strict=True)
            before_seam = [self._before_seam(end, start, arc, seam) for end, start, arc in lasts]

        def settle() -> None:
            self._wheel.settle(arcs)
            self._remember(capsules, decoded.distance)

        return decoded_steady(decoded, arcs.typical, FULL_TURN_Q6, packet_ends, self.samples, before_seam, settle)

    def _read(self, packets: Packets, following: bytes | None) -> tuple[Words, Words | None, Ints, int | None]:
        """The packets and the next one as words, where each begins, and where the next one does, if it is known."""
        words = np.frombuffer(packets.data, "<u2").reshape(-1, self.size // 2)
        column = self.start_at // 2
        starts = _in_range(words[:, column].astype(np.int32))
        if following is None:
            return words, None, starts, None
        after = np.frombuffer(following, "<u2")
        return words, after, starts, (int(after[column]) & ANGLE_MASK) % FULL_TURN_Q6

    def _samples_of(self, capsules: Capsules, starts: Ints, arc: Arc, room: int) -> Decoded:
        """Degrees, millimetres and intensities of all samples, behind `room` free places."""
        end = room + len(starts) * self.samples
        angle, distance = np.empty(end, np.float32), np.empty(end, np.float32)
        grid = angle[room:].reshape(-1, self.samples)
        each = np.empty((len(starts), 2), np.float32)
        each[:, 0], each[:, 1] = starts, arc
        np.matmul(each, self._steps, out=grid)
        intensity = self._payload(capsules, distance[room:].reshape(-1, self.samples), grid)
        in_turn(grid, FULL_TURN_Q6 * self.samples, back=self.corrected)
        angle[room:] /= self._units
        if intensity is not None and room:
            intensity = np.concatenate((np.empty(room, np.uint8), intensity))
        return Decoded(angle, distance, intensity)

    def _remember(self, capsules: Capsules, distance: Floats) -> None:  # noqa: B027 - most need nothing
        """Keep what the next packets need of these."""

    @abstractmethod
    def _payload(self, capsules: Capsules, distance: Floats, angle: Floats) -> Bytes | None:
        """Write distances in mm, take corrections off the angles, both (packets, samples); return intensities."""

    def _before_seam(self, packets: int, start: int, arc: float, seam: int) -> int:
        """How many samples lie before the rotor passed `seam` in the last of so many packets."""
        left = FULL_TURN_Q6 - (start - seam) % FULL_TURN_Q6
        inside = -int(-left * self.samples // arc) if arc else self.samples
        return (packets - 1) * self.samples + min(inside, self.samples)


class DenseDecoder(CapsuleDecoder):
    """0x85: the cabin is the distance in millimetres."""

    size: ClassVar[int] = DenseFormat.shortest
    samples: ClassVar[int] = 40

    def _payload(self, capsules: Capsules, distance: Floats, angle: Floats) -> None:  # noqa: ARG002
        distance[...] = capsules.words[:, 2:]


class ExpressDecoder(CapsuleDecoder):
    """0x82: each sample carries its own correction of the angle."""

    size: ClassVar[int] = ExpressFormat.shortest
    samples: ClassVar[int] = 32
    corrected: ClassVar[bool] = True

    def _payload(self, capsules: Capsules, distance: Floats, angle: Floats) -> None:
        millimetres, eighths = express_cabins(np.ascontiguousarray(capsules.words[:, 2:]))
        distance[...] = millimetres.reshape(distance.shape)
        angle -= eighths.reshape(angle.shape) * np.float32(self._units / 8)


class UltraDecoder(CapsuleDecoder):
    """0x84: scaled and predicted distances; the angle is corrected by the distance."""

    size: ClassVar[int] = UltraFormat.shortest
    samples: ClassVar[int] = 96
    corrected: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__()
        self._corrections = near_range_corrections(self._units)

    def _payload(self, capsules: Capsules, distance: Floats, angle: Floats) -> None:
        after = capsules.after
        # Behind the first four bytes of a capsule, each cabin has four.
        cabins = capsules.words.view("<u4")[:, 1:].astype(np.intp)
        follower = None if after is None else int(after[2]) | int(after[3]) << 16
        millimetres = ultra_cabins(cabins, follower, capsules.missing)
        distance[...] = millimetres
        angle -= self._corrections.take(millimetres)


class UltraDenseDecoder(CapsuleDecoder):
    """0x86: 20 bits a sample, distance and intensity on a sliding scale; short distances are smoothed."""

    size: ClassVar[int] = UltraDenseFormat.shortest
    start_at: ClassVar[int] = UltraDenseFormat.start_at
    samples: ClassVar[int] = 64

    def __init__(self) -> None:
        super().__init__()
        self._last_q2 = 0

    def _payload(self, capsules: Capsules, distance: Floats, angle: Floats) -> Bytes:  # noqa: ARG002
        distance_q2, intensity = ultra_dense_cabins(
            np.ascontiguousarray(capsules.words[:, 5:]), self._last_q2, capsules.missing
        )
        distance[...] = distance_q2.reshape(distance.shape)
        distance *= np.float32(0.25)
        return intensity

    def _remember(self, capsules: Capsules, distance: Floats) -> None:
        """As `CapsuleDecoder._remember`: the last distance, for the smoothing of the next one."""
        missing_behind = capsules.missing is not None and capsules.missing[-1] > 0
        self._last_q2 = 0 if missing_behind else int(distance[-1] * 4)


def _in_range(starts: Ints) -> Ints:
    """Start angles without the flag beside them, below 360 degrees; mostly they are so already."""
    return starts if np.maximum.reduce(starts) < FULL_TURN_Q6 else (starts & ANGLE_MASK) % FULL_TURN_Q6
