"""The six formats' packets of one stretch of stream, decoded at once into arrays.

Sources: S-series interface manual for 0x81 and 0x85; vendor's SDK 2.1.0 for 0x82, 0x83, 0x84 and 0x86 and for
everything the manual leaves out. Two things differ from the SDK on purpose: angles keep their full precision
(the SDK truncates to 1/64 degrees), and formats that carry no intensity report none (the SDK reports 188).

All distances are millimetres, 0 where nothing came back; all angles degrees, clockwise.

A turn is some thousand samples, and each call of numpy costs as much as a pass over all of them: so arrays are
written where they will stay, in single precision, and in units in which angles are whole numbers until the very
last division. Single precision holds those exactly.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples
from lidario.families.rplidar.cabins import (
    express_cabins,
    near_range_corrections,
    ultra_cabins,
    ultra_dense_cabins,
)
from lidario.families.rplidar.formats import ANGLE_MASK, FULL_TURN_Q6, FULL_TURN_Q14, CapsuleFormat, UltraDenseFormat
from lidario.families.rplidar.rotation import Arcs, Rotation

__all__ = [
    "DECODERS",
    "CapsuleDecoder",
    "DenseDecoder",
    "ExpressDecoder",
    "HqDecoder",
    "NodeDecoder",
    "UltraDecoder",
    "UltraDenseDecoder",
]

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]

NODE: Final = np.dtype([("quality", "u1"), ("angle", "<u2"), ("distance", "<u2")])
HQ_NODE: Final = np.dtype([("angle", "<u2"), ("distance", "<u4"), ("quality", "u1"), ("flag", "u1")])
HQ: Final = np.dtype([("sync", "u1"), ("time", "<u8"), ("nodes", HQ_NODE, 96), ("crc", "<u4")])
DENSE: Final = np.dtype([("sync", "u1", 2), ("start", "<u2"), ("cabins", "<u2", 40)])
EXPRESS: Final = np.dtype([("sync", "u1", 2), ("start", "<u2"), ("cabins", "u1", 80)])
ULTRA: Final = np.dtype([("sync", "u1", 2), ("start", "<u2"), ("cabins", "<u4", 32)])
ULTRA_DENSE: Final = np.dtype(
    [("sync", "u1", 2), ("time", "<u4"), ("status", "<u2"), ("start", "<u2"), ("cabins", "u1", 160)]
)


def in_turn(angles: Floats, full_turn: float) -> Floats:
    """Angles brought into [0, full_turn); they are at most one turn outside. Changes and returns `angles`."""
    np.add(angles, full_turn, out=angles, where=angles < 0)
    # A tiny negative angle plus a turn rounds up to the turn itself.
    np.subtract(angles, full_turn, out=angles, where=angles >= full_turn)
    return angles


class CapsuleDecoder(ABC):
    """What the four capsule formats have in common: samples at equal steps from the start angle.

    While it works, angles are counted in units of which a degree has 64 for each sample of a packet: whole
    numbers, as long as no arc had to be guessed.

    Attributes:
        layout: The packet as a structure.
        start_at: Offset of the start angle.
        samples: Samples in one packet.
        reach: How far corrections may take an angle back, and how far ahead, in 1/64 degrees.
    """

    layout: ClassVar[np.dtype[np.void]]
    start_at: ClassVar[int] = CapsuleFormat.start_at
    samples: ClassVar[int]
    reach: ClassVar[tuple[int, int]] = (0, 0)

    def __init__(self) -> None:
        self._rotation = Rotation(FULL_TURN_Q6)
        self._order = np.arange(self.samples, dtype=np.float32)
        self._units = 64.0 * self.samples

    def decode(self, packets: bytes, following: bytes | None, room: int = 0) -> Samples:
        """As `Decoder.decode`."""
        rows = np.frombuffer(packets, self.layout)
        starts = _in_range(rows["start"].astype(np.int32))
        arcs = self._rotation.arcs(starts, None if following is None else self._start(following))
        size = room + len(rows) * self.samples
        angle, distance = np.empty(size, np.float32), np.empty(size, np.float32)
        grid = angle[room:].reshape(len(rows), self.samples)
        np.multiply(arcs.arc.astype(np.float32)[:, None], self._order, out=grid)
        grid += (starts * self.samples).astype(np.float32)[:, None]
        after = None if following is None else np.frombuffer(following, self.layout)
        intensity = self._payload(rows, after, arcs, distance[room:].reshape(grid.shape), grid)
        self._bring_into_turn(grid, starts, arcs)
        angle[room:] /= self._units
        first, last_arc = int(starts[-1]) * self.samples, float(arcs.arc[-1])
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=None if intensity is None else np.concatenate((np.empty(room, np.uint8), intensity)),
            last_beam_deg=(first + last_arc * np.arange(self.samples)) / self._units,
            ends=range(self.samples, size - room + 1, self.samples),
            lost=arcs.lost,
            unbroken=arcs.unbroken,
            lost_behind=arcs.lost_behind,
        )

    @abstractmethod
    def _payload(
        self, rows: NDArray[np.void], after: NDArray[np.void] | None, arcs: Arcs, distance: Floats, angle: Floats
    ) -> Bytes | None:
        """Write distances in mm, take corrections off the angles, both (packets, samples); return intensities."""

    def _start(self, packet: bytes) -> int:
        at = self.start_at
        return ((packet[at] | packet[at + 1] << 8) & ANGLE_MASK) % FULL_TURN_Q6

    def _bring_into_turn(self, angle: Floats, starts: NDArray[np.int32], arcs: Arcs) -> None:
        """Take whole turns off the angles of those few packets that may lie across 0."""
        back, ahead = self.reach
        across = starts + arcs.arc > FULL_TURN_Q6 - ahead
        if back:
            across |= starts < back
        edge = across.nonzero()[0]
        if len(edge):
            angle[edge] = in_turn(angle[edge], FULL_TURN_Q6 * self.samples)


class DenseDecoder(CapsuleDecoder):
    """0x85: the cabin is the distance in millimetres."""

    layout, samples = DENSE, 40

    def _payload(
        self,
        rows: NDArray[np.void],
        after: NDArray[np.void] | None,  # noqa: ARG002
        arcs: Arcs,  # noqa: ARG002
        distance: Floats,
        angle: Floats,  # noqa: ARG002
    ) -> None:
        distance[...] = rows["cabins"]


class ExpressDecoder(CapsuleDecoder):
    """0x82: each sample carries its own correction of the angle."""

    layout, samples = EXPRESS, 32
    reach = (8 << 6, 0)

    def _payload(
        self,
        rows: NDArray[np.void],
        after: NDArray[np.void] | None,  # noqa: ARG002
        arcs: Arcs,  # noqa: ARG002
        distance: Floats,
        angle: Floats,
    ) -> None:
        millimetres, eighths = express_cabins(np.ascontiguousarray(rows["cabins"]))
        distance[...] = millimetres.reshape(distance.shape)
        angle -= eighths.reshape(angle.shape) * np.float32(self._units / 8)


class UltraDecoder(CapsuleDecoder):
    """0x84: scaled and predicted distances; the angle is corrected by the distance."""

    layout, samples = ULTRA, 96
    reach = (8 << 6, 30 << 6)

    def __init__(self) -> None:
        super().__init__()
        self._corrections = near_range_corrections(self._units)

    def _payload(
        self, rows: NDArray[np.void], after: NDArray[np.void] | None, arcs: Arcs, distance: Floats, angle: Floats
    ) -> None:
        cabins = rows["cabins"].astype(np.intp)
        ultra_cabins(cabins, None if after is None else int(after["cabins"][0, 0]), arcs.missing, distance)
        angle -= self._corrections.take(distance.astype(np.intp))


class UltraDenseDecoder(CapsuleDecoder):
    """0x86: 20 bits a sample, distance and intensity on a sliding scale; short distances are smoothed."""

    layout, start_at, samples = ULTRA_DENSE, UltraDenseFormat.start_at, 64

    def __init__(self) -> None:
        super().__init__()
        self._last_q2 = 0

    def _payload(
        self,
        rows: NDArray[np.void],
        after: NDArray[np.void] | None,  # noqa: ARG002
        arcs: Arcs,  # noqa: ARG002
        distance: Floats,
        angle: Floats,  # noqa: ARG002
    ) -> Bytes:
        distance_q2, intensity = ultra_dense_cabins(np.ascontiguousarray(rows["cabins"]), self._last_q2)
        self._last_q2 = int(distance_q2[-1])
        distance[...] = distance_q2.reshape(distance.shape)
        distance /= 4.0
        return intensity


class HqDecoder:
    """0x83: whole nodes, passed through."""

    samples = 96

    def __init__(self) -> None:
        self._rotation = Rotation(FULL_TURN_Q14)

    def decode(self, packets: bytes, following: bytes | None, room: int = 0) -> Samples:
        """As `Decoder.decode`."""
        rows = np.frombuffer(packets, HQ)
        nodes = rows["nodes"]
        after = None if following is None else int(np.frombuffer(following, HQ)["nodes"]["angle"][0, 0])
        arcs = self._rotation.arcs(nodes["angle"][:, 0].astype(np.int32), after)
        size = room + nodes.size
        angle, distance, intensity = (np.empty(size, kind) for kind in (np.float32, np.float32, np.uint8))
        angle[room:].reshape(nodes.shape)[...] = nodes["angle"]
        distance[room:].reshape(nodes.shape)[...] = nodes["distance"]
        intensity[room:].reshape(nodes.shape)[...] = nodes["quality"]
        angle[room:] *= 360.0 / FULL_TURN_Q14
        distance[room:] /= 4.0
        last = nodes["angle"][-1].astype(np.int64)
        last[last < last[0] - FULL_TURN_Q14 // 2] += FULL_TURN_Q14
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            last_beam_deg=last * (360.0 / FULL_TURN_Q14),
            ends=range(self.samples, nodes.size + 1, self.samples),
            lost=arcs.lost,
            unbroken=arcs.unbroken,
            lost_behind=arcs.lost_behind,
        )


class NodeDecoder:
    """0x81: the plain node."""

    def __init__(self) -> None:
        # Nodes carry corrected angles, which scatter by most of a step: only a doubled step is a lost node.
        self._rotation = Rotation(FULL_TURN_Q6, jitter=0.75)

    def decode(self, packets: bytes, following: bytes | None, room: int = 0) -> Samples:
        """As `Decoder.decode`."""
        rows = np.frombuffer(packets, NODE)
        angles = (rows["angle"] >> 1).astype(np.int32)
        arcs = self._rotation.arcs(angles, None if following is None else following[1] >> 1 | following[2] << 7)
        size = room + len(rows)
        angle, distance, intensity = (np.empty(size, kind) for kind in (np.float32, np.float32, np.uint8))
        np.divide(angles, 64.0, out=angle[room:], dtype=np.float32, casting="same_kind")
        distance[room:] = rows["distance"]
        distance[room:] /= 4.0
        np.bitwise_and(rows["quality"], 0xFC, out=intensity[room:])
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            last_beam_deg=angles[-1:] / 64.0,
            ends=range(1, len(rows) + 1),
            lost=arcs.lost,
            unbroken=arcs.unbroken,
            lost_behind=arcs.lost_behind,
        )


def _in_range(starts: NDArray[np.int32]) -> NDArray[np.int32]:
    """Start angles without the flag beside them, below a turn; mostly they are so already."""
    return starts if starts.max() < FULL_TURN_Q6 else (starts & ANGLE_MASK) % FULL_TURN_Q6


DECODERS: Final[dict[int, Callable[[], CapsuleDecoder | HqDecoder | NodeDecoder]]] = {
    0x81: NodeDecoder,
    0x82: ExpressDecoder,
    0x83: HqDecoder,
    0x84: UltraDecoder,
    0x85: DenseDecoder,
    0x86: UltraDenseDecoder,
}
"""Answer type -> decoder, one row for each row of `formats.FORMATS`."""
