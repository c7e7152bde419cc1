"""The six formats' packets of one stretch of stream, decoded at once into arrays.

Sources: S-series interface manual for 0x81 and 0x85; vendor's SDK 2.1.0 for 0x82, 0x83, 0x84 and 0x86 and for
everything the manual leaves out. Two things differ from the SDK on purpose: angles keep their full precision
(the SDK truncates to 1/64 degrees), and formats that carry no intensity report none (the SDK reports 188).

All distances are millimetres, 0 where nothing came back; all angles degrees, clockwise.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples
from lidario.families.rplidar.cabins import (
    UltraCabins,
    express_cabins,
    near_range_correction,
    ultra_dense_cabins,
)
from lidario.families.rplidar.formats import ANGLE_MASK, FULL_TURN_Q6, FULL_TURN_Q14
from lidario.families.rplidar.rotation import Rotation

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
Floats = NDArray[np.float64]

NODE: Final = np.dtype([("quality", "u1"), ("angle", "<u2"), ("distance", "<u2")])
HQ_NODE: Final = np.dtype([("angle", "<u2"), ("distance", "<u4"), ("quality", "u1"), ("flag", "u1")])
HQ: Final = np.dtype([("sync", "u1"), ("time", "<u8"), ("nodes", HQ_NODE, 96), ("crc", "<u4")])
DENSE: Final = np.dtype([("sync", "u1", 2), ("start", "<u2"), ("cabins", "<u2", 40)])
EXPRESS_CABIN: Final = np.dtype([("words", "<u2", 2), ("offsets", "u1")])
EXPRESS: Final = np.dtype([("sync", "u1", 2), ("start", "<u2"), ("cabins", EXPRESS_CABIN, 16)])
ULTRA: Final = np.dtype([("sync", "u1", 2), ("start", "<u2"), ("cabins", "<u4", 32)])
ULTRA_DENSE_CABIN: Final = np.dtype([("low", "<u2", 2), ("high", "u1")])
ULTRA_DENSE: Final = np.dtype(
    [
        ("sync", "u1", 2),
        ("time", "<u4"),
        ("status", "<u2"),
        ("start", "<u2"),
        ("cabins", ULTRA_DENSE_CABIN, 32),
    ]
)


def in_turn(degrees: Floats) -> Floats:
    """Angles brought into [0, 360); they are at most one turn outside. Changes and returns `degrees`."""
    if degrees.min() < 0.0:
        np.add(degrees, 360.0, out=degrees, where=degrees < 0.0)
    # A tiny negative angle plus a turn rounds up to the turn itself.
    np.subtract(degrees, 360.0, out=degrees, where=degrees >= 360.0)
    return degrees


class CapsuleDecoder(ABC):
    """What the four capsule formats have in common: samples at equal steps from the start angle.

    Attributes:
        layout: The packet as a structure.
        samples: Samples in one packet.
    """

    layout: ClassVar[np.dtype[np.void]]
    samples: ClassVar[int]

    def __init__(self) -> None:
        self._rotation = Rotation(FULL_TURN_Q6)
        self._steps = np.arange(self.samples) / (64.0 * self.samples)

    def decode(self, packets: bytes, following: bytes | None) -> Samples:
        """As `Decoder.decode`."""
        rows = np.frombuffer(packets, self.layout)
        after = np.frombuffer(following, self.layout) if following is not None else None
        starts = self._starts(rows)
        arcs = self._rotation.arcs(starts, None if after is None else int(self._starts(after)[0]))
        gaps = np.flatnonzero(arcs.missing)
        beam = starts[:, None] / 64.0 + arcs.arc[:, None] * self._steps
        followed = arcs.missing == 0
        if after is None:
            followed[-1] = False
        distance, intensity, correction = self._payload(rows, after, followed)
        beam = beam.ravel()
        return Samples(
            beam_deg=beam,
            angle_deg=in_turn(beam.copy() if correction is None else beam - correction.ravel()),
            distance_mm=distance.ravel(),
            intensity=None if intensity is None else intensity.ravel(),
            ends=np.arange(1, len(rows) + 1) * self.samples,
            lost=int(arcs.missing.sum()),
            unbroken=int(gaps[0]) + 1 if len(gaps) else len(rows),
            lost_behind=int(arcs.missing[-1]),
        )

    @abstractmethod
    def _payload(
        self, rows: NDArray[np.void], after: NDArray[np.void] | None, followed: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], Bytes | None, Floats | None]:
        """Distances in mm, intensities and degrees to subtract, each (packets, samples)."""

    @staticmethod
    def _starts(rows: NDArray[np.void]) -> NDArray[np.int64]:
        return (rows["start"].astype(np.int64) & ANGLE_MASK) % FULL_TURN_Q6


class DenseDecoder(CapsuleDecoder):
    """0x85: the cabin is the distance in millimetres."""

    layout, samples = DENSE, 40

    def _payload(
        self,
        rows: NDArray[np.void],
        after: NDArray[np.void] | None,  # noqa: ARG002
        followed: NDArray[np.bool_],  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Bytes | None, Floats | None]:
        return rows["cabins"].astype(np.float32), None, None


class ExpressDecoder(CapsuleDecoder):
    """0x82: each sample carries its own correction of the angle."""

    layout, samples = EXPRESS, 32

    def _payload(
        self,
        rows: NDArray[np.void],
        after: NDArray[np.void] | None,  # noqa: ARG002
        followed: NDArray[np.bool_],  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Bytes | None, Floats | None]:
        distance, correction = express_cabins(rows["cabins"]["words"], rows["cabins"]["offsets"])
        return distance, None, correction


class UltraDecoder(CapsuleDecoder):
    """0x84: scaled and predicted distances; the angle is corrected by the distance."""

    layout, samples = ULTRA, 96

    def __init__(self) -> None:
        super().__init__()
        self._cabins = UltraCabins()

    def _payload(
        self, rows: NDArray[np.void], after: NDArray[np.void] | None, followed: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], Bytes | None, Floats | None]:
        follower = rows["cabins"][-1, 0] if after is None else after["cabins"][0, 0]
        distance = self._cabins.distances(rows["cabins"], int(follower), followed)
        return distance, None, near_range_correction(distance)


class UltraDenseDecoder(CapsuleDecoder):
    """0x86: 20 bits a sample, distance and intensity on a sliding scale; short distances are smoothed."""

    layout, samples = ULTRA_DENSE, 64

    def __init__(self) -> None:
        super().__init__()
        self._last_q2 = 0

    def _payload(
        self,
        rows: NDArray[np.void],
        after: NDArray[np.void] | None,  # noqa: ARG002
        followed: NDArray[np.bool_],  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Bytes | None, Floats | None]:
        distance_q2, intensity = ultra_dense_cabins(rows["cabins"]["low"], rows["cabins"]["high"], self._last_q2)
        self._last_q2 = int(distance_q2[-1])
        return (distance_q2 / np.float32(4)).astype(np.float32), intensity, None


class HqDecoder:
    """0x83: whole nodes, passed through."""

    samples = 96

    def __init__(self) -> None:
        self._rotation = Rotation(FULL_TURN_Q14)

    def decode(self, packets: bytes, following: bytes | None) -> Samples:
        """As `Decoder.decode`."""
        rows = np.frombuffer(packets, HQ)
        nodes = rows["nodes"]
        angles = nodes["angle"].astype(np.int64)
        after = None if following is None else int(np.frombuffer(following, HQ)["nodes"]["angle"][0, 0])
        missing = self._rotation.arcs(angles[:, 0], after).missing
        gaps = np.flatnonzero(missing)
        angle = angles.astype(np.float64) * (360.0 / FULL_TURN_Q14)
        beam = angle + 360.0 * (angles < angles[:, :1] - FULL_TURN_Q14 // 2)
        return Samples(
            beam_deg=beam.ravel(),
            angle_deg=angle.ravel(),
            distance_mm=(nodes["distance"] / 4.0).astype(np.float32).ravel(),
            intensity=nodes["quality"].ravel(),
            ends=np.arange(1, len(rows) + 1) * self.samples,
            lost=int(missing.sum()),
            unbroken=int(gaps[0]) + 1 if len(gaps) else len(rows),
            lost_behind=int(missing[-1]),
        )


class NodeDecoder:
    """0x81: the plain node."""

    def __init__(self) -> None:
        # Nodes carry corrected angles, which scatter by most of a step: only a doubled step is a lost node.
        self._rotation = Rotation(FULL_TURN_Q6, jitter=0.75)

    def decode(self, packets: bytes, following: bytes | None) -> Samples:
        """As `Decoder.decode`."""
        rows = np.frombuffer(packets, NODE)
        angles = rows["angle"].astype(np.int64) >> 1
        after = None if following is None else int(np.frombuffer(following, NODE)["angle"][0]) >> 1
        missing = self._rotation.arcs(angles, after).missing
        gaps = np.flatnonzero(missing)
        beam = angles.astype(np.float64) / 64.0
        return Samples(
            beam_deg=beam,
            angle_deg=beam,
            distance_mm=rows["distance"].astype(np.float32) / np.float32(4),
            intensity=rows["quality"] & np.uint8(0xFC),
            ends=np.arange(1, len(rows) + 1),
            lost=int(missing.sum()),
            unbroken=int(gaps[0]) + 1 if len(gaps) else len(rows),
            lost_behind=int(missing[-1]),
        )


DECODERS: Final[dict[int, Callable[[], CapsuleDecoder | HqDecoder | NodeDecoder]]] = {
    0x81: NodeDecoder,
    0x82: ExpressDecoder,
    0x83: HqDecoder,
    0x84: UltraDecoder,
    0x85: DenseDecoder,
    0x86: UltraDenseDecoder,
}
"""Answer type -> decoder, one row for each row of `formats.FORMATS`."""
