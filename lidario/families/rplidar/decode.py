"""The decoders of the six formats: the packets of one stretch of stream, decoded at once into arrays.

Sources: S-series interface manual for 0x81 and 0x85; vendor's SDK 2.1.0 for 0x82, 0x83, 0x84 and 0x86 and for
everything the manual leaves out. Two things differ from the SDK on purpose: angles keep their full precision
(the SDK truncates to 1/64 degrees), and formats that carry no intensity report none (the SDK reports 188).

A capsule states where it begins. Its samples lie at equal steps from there, up to where the next one begins. So the
angles of a whole stretch are one product of two small matrices. `cabins` decodes the cabins. In 0x81 and 0x83 each
sample has its own angle.

A revolution has some thousand samples, and each call of numpy costs as much as a pass over all of them. So arrays
are written directly to their final place, in single precision, and in units in which angles are whole numbers until
the last division. Single precision holds these exactly.
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Output, at_equal_steps, in_turn
from lidario.families.base import Decoder
from lidario.families.rplidar.cabins import express_cabins, near_range_corrections, ultra_cabins, ultra_dense_cabins
from lidario.families.rplidar.chains import FULL_TURN_Q6
from lidario.families.rplidar.formats import (
    ANGLE_MASK,
    FULL_TURN_Q14,
    HQ,
    CapsuleFormat,
    DenseFormat,
    ExpressFormat,
    UltraDenseFormat,
    UltraFormat,
)
from lidario.families.rplidar.node_steps import Nodes, NodeSteps
from lidario.families.rplidar.nodes import NODE
from lidario.families.spans import Arcs, Heads, Ints
from lidario.families.told import ToldWheel
from lidario.families.wheel import Wheel
from lidario.wire.events import Packets

Words = NDArray[np.uint16]

FIRST_ANGLE: Final = 9  # offset of the first node's angle in a packet of 0x83


class CapsuleDecoder(ArcDecoder):
    """The base of the four capsule decoders: samples lie at equal steps from the start angle."""

    wire: ClassVar[type[CapsuleFormat]]  # the format of the packets
    has_intensity: bool = False
    corrected: ClassVar[bool] = False  # whether samples have corrections, which may move an angle back over 0

    def __init__(self) -> None:
        super().__init__(FULL_TURN_Q6, Wheel(FULL_TURN_Q6, self.wire.samples))
        self._units = 64.0 * self.wire.samples

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        words = np.frombuffer(packets.data, "<u2").reshape(-1, self.wire.shortest // 2)
        at = self.wire.start_at
        starts: Ints = (words[:, at // 2].astype(np.int32) & ANGLE_MASK) % FULL_TURN_Q6
        behind = None
        if following is not None:
            behind = (int.from_bytes(following[at : at + 2], "little") & ANGLE_MASK) % FULL_TURN_Q6
        return Heads(starts, behind, self.wire.samples, None, (words, following))

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:
        at_equal_steps(heads.first, arcs.arc, self.wire.samples, output.angle)
        words, after = heads.read
        self._payload(words, after, arcs.skipped, output)
        in_turn(output.angle, FULL_TURN_Q6 * self.wire.samples, back=self.corrected)
        output.angle /= self._units

    @abstractmethod
    def _payload(self, words: Words, after: bytes | None, skipped: NDArray[np.intp] | None, output: Output) -> None:
        """Write distances and intensities, and subtract corrections from the angles in `output`.

        `words` are the words of the packets, shape (packets, words of one), and `after` is the packet behind them.
        """


class DenseDecoder(CapsuleDecoder):
    """0x85: each cabin is a distance in millimetres."""

    wire: ClassVar[type[CapsuleFormat]] = DenseFormat

    def _payload(self, words: Words, after: Any, skipped: Any, output: Output) -> None:  # noqa: ARG002
        output.distance[...] = words[:, 2:]


class ExpressDecoder(CapsuleDecoder):
    """0x82: each sample carries its own correction of the angle."""

    wire: ClassVar[type[CapsuleFormat]] = ExpressFormat
    corrected: ClassVar[bool] = True

    def _payload(self, words: Words, after: Any, skipped: Any, output: Output) -> None:  # noqa: ARG002
        millimetres, eighths = express_cabins(np.ascontiguousarray(words[:, 2:]))
        output.distance[...] = millimetres.reshape(output.distance.shape)
        output.angle -= eighths.reshape(output.angle.shape) * np.float32(self._units / 8)


class UltraDecoder(CapsuleDecoder):
    """0x84: scaled and predicted distances; the angle is corrected by the distance."""

    wire: ClassVar[type[CapsuleFormat]] = UltraFormat
    corrected: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__()
        self._corrections = near_range_corrections(self._units)

    def _payload(self, words: Words, after: Any, skipped: Any, output: Output) -> None:
        # After the first four bytes of a capsule, each cabin has four bytes.
        cabins = words.view("<u4")[:, 1:].astype(np.intp)
        millimetres = ultra_cabins(cabins, None if after is None else int.from_bytes(after[4:6], "little"), skipped)
        output.distance[...] = millimetres
        output.angle -= self._corrections.take(millimetres)


class UltraDenseDecoder(CapsuleDecoder):
    """0x86: 20 bits a sample, distance and intensity on a variable scale; short distances are smoothed."""

    wire: ClassVar[type[CapsuleFormat]] = UltraDenseFormat
    has_intensity = True

    def __init__(self) -> None:
        super().__init__()
        self._last_q2 = 0

    def _payload(self, words: Words, after: Any, skipped: Any, output: Output) -> None:  # noqa: ARG002
        distance_q2, intensity = ultra_dense_cabins(np.ascontiguousarray(words[:, 5:]), self._last_q2, skipped)
        output.distance[...] = distance_q2.reshape(output.distance.shape)
        output.distance *= np.float32(0.25)
        output.intensity[...] = intensity.reshape(output.intensity.shape)
        # For the smoothing of the next distance.
        self._last_q2 = 0 if skipped is not None and skipped[-1] else int(distance_q2[-1])


class HqDecoder(ArcDecoder):
    """0x83: packets of whole nodes, each with its own angle."""

    samples = 96

    def __init__(self) -> None:
        super().__init__(FULL_TURN_Q14, ToldWheel(FULL_TURN_Q14, self.samples / 2))

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        nodes: NDArray[np.void] = np.frombuffer(packets.data, HQ)["nodes"]
        angles = nodes["angle"]
        after = None if following is None else following[FIRST_ANGLE] | following[FIRST_ANGLE + 1] << 8
        # Unsigned 16 bits hold exactly 360 degrees.
        way = (angles[:, -1] - angles[:, 0]).astype(np.int32)
        return Heads(angles[:, 0].astype(np.int32), after, self.samples, way, nodes)

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:  # noqa: ARG002 - nodes are not moved
        nodes = heads.read
        np.multiply(nodes["angle"], np.float32(360.0 / FULL_TURN_Q14), out=output.angle)
        np.multiply(nodes["distance"], 0.25, out=output.distance, dtype=np.float32, casting="same_kind")
        output.intensity[...] = nodes["quality"]

    def _behind_seam(self, heads: Heads, arcs: Arcs, at: int, seam: int) -> int:  # noqa: ARG002
        """How many nodes of a packet lie behind the seam; all lie ahead of its first one."""
        angles = heads.read["angle"][at]
        left = FULL_TURN_Q14 - (int(angles[0]) - seam) % FULL_TURN_Q14
        # Unsigned 16 bits hold exactly 360 degrees: a node before the seam seems to be far behind it.
        beyond = angles - np.uint16(seam)
        return int(np.count_nonzero(beyond < FULL_TURN_Q14 // 2 - left))


class NodeDecoder(ArcDecoder):
    """0x81: plain nodes, each a packet of one sample."""

    def __init__(self) -> None:
        super().__init__(FULL_TURN_Q6, NodeSteps(FULL_TURN_Q6))

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        rows: NDArray[np.void] = np.frombuffer(packets.data, NODE)
        after = None if following is None else following[1] >> 1 | following[2] << 7
        return Heads((rows["angle"] >> 1).astype(np.int32), after, 1, None, Nodes(rows, following))

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:  # noqa: ARG002 - nodes are not moved
        rows, distance = heads.read.rows, output.distance[:, 0]
        np.divide(heads.first, 64.0, out=output.angle[:, 0], dtype=np.float32, casting="same_kind")
        distance[...] = rows["distance"]
        distance *= 0.25
        np.bitwise_and(rows["quality"], 0xFC, out=output.intensity[:, 0])


DECODERS: Final[dict[int, Callable[[], Decoder]]] = {
    0x81: NodeDecoder,
    0x82: ExpressDecoder,
    0x83: HqDecoder,
    0x84: UltraDecoder,
    0x85: DenseDecoder,
    0x86: UltraDenseDecoder,
}
"""Response type -> decoder, one row for each row of `formats.FORMATS`."""
