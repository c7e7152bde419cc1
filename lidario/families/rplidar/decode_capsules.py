"""The decoders of the four capsule formats, 0x82, 0x84, 0x85 and 0x86.

A capsule states where it begins; its samples lie at equal steps from there, up to where the next one begins. So the
angles of a whole stretch are one product of two small matrices. What is inside the cabins stands in `cabins`.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Output, at_equal_steps, in_turn, starts_and_arcs
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

Words = NDArray[np.uint16]


class CapsuleDecoder(ArcDecoder):
    """What the four capsule formats have in common: samples at equal steps from the start angle.

    Attributes:
        wire: Their format.
        corrected: Whether samples have corrections, which may take an angle back over 0.
    """

    wire: ClassVar[type[CapsuleFormat]]
    corrected: ClassVar[bool] = False

    def __init__(self) -> None:
        super().__init__(FULL_TURN_Q6, Wheel(FULL_TURN_Q6, self.wire.samples))
        self._units = 64.0 * self.wire.samples

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        words = np.frombuffer(packets.data, "<u2").reshape(-1, self.wire.shortest // 2)
        column = self.wire.start_at // 2
        starts: Ints = words[:, column].astype(np.int32)
        if np.maximum.reduce(starts) >= FULL_TURN_Q6:
            # Mostly none has the flag beside it.
            starts = (starts & ANGLE_MASK) % FULL_TURN_Q6
        if following is None:
            return Heads(starts, None, self.wire.samples, None, (words, None))
        behind = int.from_bytes(following[2 * column : 2 * column + 2], "little")
        return Heads(starts, (behind & ANGLE_MASK) % FULL_TURN_Q6, self.wire.samples, None, (words, following))

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:
        at_equal_steps(starts_and_arcs(heads.first, arcs.arc), self.wire.samples, output.angle)
        words, after = heads.read
        self._payload(words, after, arcs.skipped, output)
        in_turn(output.angle, FULL_TURN_Q6 * self.wire.samples, back=self.corrected)
        output.angle /= self._units
        is_cut = arcs.skipped is not None and arcs.skipped[-1] > 0
        output.last = 0.0 if is_cut else float(output.distance[-1, -1])

    @abstractmethod
    def _payload(self, words: Words, after: bytes | None, skipped: NDArray[np.intp] | None, output: Output) -> None:
        """Write distances and intensities, and take corrections off the angles.

        Args:
            words: The packets, shape (packets, words of one).
            after: The packet behind them, if known.
            skipped: Samples missing behind each, shape (packets,); None when none is.
            output: Where distances go, and the angles stand.
        """


class DenseDecoder(CapsuleDecoder):
    """0x85: the cabin is the distance in millimetres."""

    wire: ClassVar[type[CapsuleFormat]] = DenseFormat
    has_intensity: bool = False

    def _payload(self, words: Words, after: Any, skipped: Any, output: Output) -> None:  # noqa: ARG002
        output.distance[...] = words[:, 2:]


class ExpressDecoder(CapsuleDecoder):
    """0x82: each sample carries its own correction of the angle."""

    wire: ClassVar[type[CapsuleFormat]] = ExpressFormat
    has_intensity: bool = False
    corrected: ClassVar[bool] = True

    def _payload(self, words: Words, after: Any, skipped: Any, output: Output) -> None:  # noqa: ARG002
        millimetres, eighths = express_cabins(np.ascontiguousarray(words[:, 2:]))
        output.distance[...] = millimetres.reshape(output.distance.shape)
        output.angle -= eighths.reshape(output.angle.shape) * np.float32(self._units / 8)


class UltraDecoder(CapsuleDecoder):
    """0x84: scaled and predicted distances; the angle is corrected by the distance."""

    wire: ClassVar[type[CapsuleFormat]] = UltraFormat
    has_intensity: bool = False
    corrected: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__()
        self._corrections = near_range_corrections(self._units)

    def _payload(self, words: Words, after: Any, skipped: Any, output: Output) -> None:
        # Behind the first four bytes of a capsule, each cabin has four.
        cabins = words.view("<u4")[:, 1:].astype(np.intp)
        millimetres = ultra_cabins(cabins, None if after is None else int.from_bytes(after[4:6], "little"), skipped)
        output.distance[...] = millimetres
        output.angle -= self._corrections.take(millimetres)


class UltraDenseDecoder(CapsuleDecoder):
    """0x86: 20 bits a sample, distance and intensity on a sliding scale; short distances are smoothed."""

    wire: ClassVar[type[CapsuleFormat]] = UltraDenseFormat

    def __init__(self) -> None:
        super().__init__()
        self._last_q2 = 0

    def _payload(self, words: Words, after: Any, skipped: Any, output: Output) -> None:  # noqa: ARG002
        distance_q2, intensity = ultra_dense_cabins(np.ascontiguousarray(words[:, 5:]), self._last_q2, skipped)
        output.distance[...] = distance_q2.reshape(output.distance.shape)
        output.distance *= np.float32(0.25)
        output.intensity[...] = intensity.reshape(output.intensity.shape)

    def _remember(self, heads: Heads, last: float) -> None:  # noqa: ARG002
        # For the smoothing of the next distance.
        self._last_q2 = int(last * 4)
