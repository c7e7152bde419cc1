"""The decoders of the four capsule formats, 0x82, 0x84, 0x85 and 0x86.

A capsule states where it begins; its samples lie at equal steps from there, up to where the next one begins. So the
angles of a whole stretch are one product of two small matrices. What is inside the cabins stands in `cabins`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Decoded, Floats, in_turn
from lidario.families.rplidar.cabins import (
    express_cabins,
    near_range_corrections,
    ultra_cabins,
    ultra_dense_cabins,
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
from lidario.families.spans import Arcs, Heads, Ints
from lidario.families.wheel import Wheel
from lidario.wire.events import Packets

__all__ = ["CapsuleDecoder", "DenseDecoder", "ExpressDecoder", "UltraDecoder", "UltraDenseDecoder"]

Bytes = NDArray[np.uint8]
Words = NDArray[np.uint16]


class Capsules(NamedTuple):
    """Packets of a capsule format, as words.

    Attributes:
        words: (packets, words of one).
        after: The packet behind them, if known.
    """

    words: Words
    after: bytes | None


class CapsuleDecoder(ArcDecoder):
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
        super().__init__(FULL_TURN_Q6, Wheel(FULL_TURN_Q6, self.samples))
        self._units = 64.0 * self.samples
        order = np.arange(self.samples, dtype=np.float32)
        self._steps = np.stack((np.full_like(order, self.samples), order))
        """What a start angle and an arc contribute to each sample of a packet."""

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        words = np.frombuffer(packets.data, "<u2").reshape(-1, self.size // 2)
        at = self.start_at
        starts = _in_range(words[:, at // 2].astype(np.int32))
        behind = None
        if following is not None:
            behind = ((following[at] | following[at + 1] << 8) & ANGLE_MASK) % FULL_TURN_Q6
        return Heads(starts, behind, self.samples, None, Capsules(words, following))

    def _samples(
        self,
        packets: Packets,  # noqa: ARG002
        heads: Heads,
        arcs: Arcs,
        ends: Sequence[int],
        room: int,
    ) -> Decoded:
        end = room + ends[-1]
        angle, distance = np.empty(end, np.float32), np.empty(end, np.float32)
        grid = angle[room:].reshape(-1, self.samples)
        each = np.empty((len(heads.first), 2), np.float32)
        each[:, 0], each[:, 1] = heads.first, arcs.arc
        np.matmul(each, self._steps, out=grid)
        intensity = self._payload(heads.read, arcs.skipped, distance[room:].reshape(-1, self.samples), grid)
        in_turn(grid, FULL_TURN_Q6 * self.samples, back=self.corrected)
        grid /= self._units
        if intensity is not None and room:
            intensity = np.concatenate((np.empty(room, np.uint8), intensity))
        is_cut = arcs.skipped is not None and arcs.skipped[-1] > 0
        return Decoded(angle, distance, intensity, 0.0 if is_cut else float(distance[-1]))

    @abstractmethod
    def _payload(
        self, capsules: Capsules, skipped: NDArray[np.intp] | None, distance: Floats, angle: Floats
    ) -> Bytes | None:
        """Write distances in mm, take corrections off the angles, both (packets, samples); return intensities.

        Args:
            capsules: The packets.
            skipped: Samples missing behind each, shape (packets,); None when none is.
            distance: Where distances go.
            angle: Where the angles stand.
        """


class DenseDecoder(CapsuleDecoder):
    """0x85: the cabin is the distance in millimetres."""

    size: ClassVar[int] = DenseFormat.shortest
    samples: ClassVar[int] = 40

    def _payload(self, capsules: Capsules, skipped: Any, distance: Floats, angle: Floats) -> None:  # noqa: ARG002
        distance[...] = capsules.words[:, 2:]


class ExpressDecoder(CapsuleDecoder):
    """0x82: each sample carries its own correction of the angle."""

    size: ClassVar[int] = ExpressFormat.shortest
    samples: ClassVar[int] = 32
    corrected: ClassVar[bool] = True

    def _payload(self, capsules: Capsules, skipped: Any, distance: Floats, angle: Floats) -> None:  # noqa: ARG002
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

    def _payload(self, capsules: Capsules, skipped: Any, distance: Floats, angle: Floats) -> None:
        after = capsules.after
        # Behind the first four bytes of a capsule, each cabin has four.
        cabins = capsules.words.view("<u4")[:, 1:].astype(np.intp)
        millimetres = ultra_cabins(cabins, None if after is None else after[4] | after[5] << 8, skipped)
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

    def _payload(self, capsules: Capsules, skipped: Any, distance: Floats, angle: Floats) -> Bytes:  # noqa: ARG002
        distance_q2, intensity = ultra_dense_cabins(
            np.ascontiguousarray(capsules.words[:, 5:]), self._last_q2, skipped
        )
        distance[...] = distance_q2.reshape(distance.shape)
        distance *= np.float32(0.25)
        return intensity

    def _remember(self, heads: Heads, last: float) -> None:  # noqa: ARG002
        # For the smoothing of the next distance.
        self._last_q2 = int(last * 4)


def _in_range(starts: Ints) -> Ints:
    """Start angles without the flag beside them, below 360 degrees; mostly they are so already."""
    return starts if np.maximum.reduce(starts) < FULL_TURN_Q6 else (starts & ANGLE_MASK) % FULL_TURN_Q6
