"""The six formats' packets of one stretch of stream, decoded at once into arrays.

Sources: S-series interface manual for 0x81 and 0x85; vendor's SDK 2.1.0 for 0x82, 0x83, 0x84 and 0x86 and for
everything the manual leaves out. Two things differ from the SDK on purpose: angles keep their full precision
(the SDK truncates to 1/64 degrees), and formats that carry no intensity report none (the SDK reports 188).

All distances are millimetres, 0 where nothing came back; all angles degrees, clockwise.

A revolution is some thousand samples, and each call of numpy costs as much as a pass over all of them. So arrays
are written where they will stay, in single precision, and in units in which angles are whole numbers until the
very last division. Single precision holds those exactly.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples, SteadySamples
from lidario.families.rplidar.cabins import (
    express_cabins,
    near_range_corrections,
    ultra_cabins,
    ultra_dense_cabins,
)
from lidario.families.rplidar.formats import (
    ANGLE_MASK,
    FULL_TURN_Q6,
    FULL_TURN_Q14,
    CapsuleFormat,
    DenseFormat,
    ExpressFormat,
    UltraDenseFormat,
    UltraFormat,
)
from lidario.families.rplidar.nodes import NODE
from lidario.families.rplidar.rotation import Rotation
from lidario.wire.events import Packets

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
Words = NDArray[np.uint16]
Floats = NDArray[np.float32]
Ints = NDArray[np.int32]

HQ_NODE: Final = np.dtype([("angle", "<u2"), ("distance", "<u4"), ("quality", "u1"), ("flag", "u1")])
HQ: Final = np.dtype([("sync", "u1"), ("time", "<u8"), ("nodes", HQ_NODE, 96), ("crc", "<u4")])


def in_turn(angles: Floats, full_turn: float) -> Floats:
    """Angles brought into [0, full_turn); they are at most 360 degrees outside. Changes and returns `angles`."""
    np.add(angles, full_turn, out=angles, where=angles < 0)
    # A tiny negative angle plus 360 degrees rounds up to 360 degrees.
    np.subtract(angles, full_turn, out=angles, where=angles >= full_turn)
    return angles


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
        reach: How far corrections may take an angle back, and how far ahead, in 1/64 degrees.
    """

    size: ClassVar[int]
    start_at: ClassVar[int] = CapsuleFormat.start_at
    samples: ClassVar[int]
    reach: ClassVar[tuple[int, int]] = (0, 0)

    def __init__(self) -> None:
        self._rotation = Rotation(FULL_TURN_Q6)
        self._units = 64.0 * self.samples
        order = np.arange(self.samples, dtype=np.float32)
        self._steps = np.stack((np.full_like(order, self.samples), order))
        """What a start angle and an arc contribute to each sample of a packet."""

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        """As `Decoder.decode`."""
        words, after, starts, next_start = self._read(packets, following)
        arcs = self._rotation.arcs(starts, next_start)
        capsules = Capsules(words, after, arcs.missing)
        angle, distance, intensity = self._samples_of(capsules, starts, arcs.arc, room)
        self._remember(capsules, distance)
        count = len(starts)
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            before_seam=count * self.samples
            if seam is None
            else self._before_seam(count, int(starts[-1]), float(arcs.arc[-1]), seam),
            ends=range(self.samples, count * self.samples + 1, self.samples),
            lost=arcs.lost,
            unbroken=arcs.unbroken,
            lost_behind=arcs.lost_behind,
            revolution_packets=FULL_TURN_Q6 / arcs.typical if arcs.typical else 0.0,
            revolution_samples=FULL_TURN_Q6 / arcs.typical * self.samples if arcs.typical else 0.0,
            certain=arcs.certain,
        )

    def decode_steady(
        self, packets: Packets, following: bytes, ends: Sequence[int], room: int = 0, seam: int | None = None
    ) -> SteadySamples | None:
        """As `Decoder.decode_steady`."""
        words, after, starts, next_start = self._read(packets, following)
        arcs = None if next_start is None else self._rotation.steady(starts, next_start, ends)
        if arcs is None:
            return None
        capsules = Capsules(words, after, None)
        angle, distance, intensity = self._samples_of(capsules, starts, arcs.arc, room)
        packet_ends = [end * self.samples for end in ends]
        last = np.array(ends) - 1

        def settle() -> None:
            self._rotation.settle(arcs)
            self._remember(capsules, distance)

        return SteadySamples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            packet_ends=packet_ends,
            before_seam=packet_ends
            if seam is None
            else [
                self._before_seam(end, start, arc, seam)
                for end, start, arc in zip(ends, starts[last].tolist(), arcs.arc[last].tolist(), strict=True)
            ],
            revolution_packets=[FULL_TURN_Q6 / each for each in arcs.typical],
            revolution_samples=[FULL_TURN_Q6 / each * self.samples for each in arcs.typical],
            settle=settle,
        )

    def _read(self, packets: Packets, following: bytes | None) -> tuple[Words, Words | None, Ints, int | None]:
        """The packets and the next one as words, where each begins, and where the next one does, if it is known."""
        words = np.frombuffer(packets.data, "<u2").reshape(-1, self.size // 2)
        column = self.start_at // 2
        starts = _in_range(words[:, column].astype(np.int32))
        if following is None:
            return words, None, starts, None
        after = np.frombuffer(following, "<u2")
        return words, after, starts, (int(after[column]) & ANGLE_MASK) % FULL_TURN_Q6

    def _samples_of(
        self, capsules: Capsules, starts: Ints, arc: Ints | NDArray[np.float64], room: int
    ) -> tuple[Floats, Floats, Bytes | None]:
        """Degrees, millimetres and intensities of all samples, behind `room` free places."""
        end = room + len(starts) * self.samples
        angle, distance = np.empty(end, np.float32), np.empty(end, np.float32)
        grid = angle[room:].reshape(-1, self.samples)
        np.matmul(np.array((starts, arc), np.float32).T, self._steps, out=grid)
        intensity = self._payload(capsules, distance[room:].reshape(-1, self.samples), grid)
        self._bring_into_turn(grid, starts, arc)
        angle[room:] /= self._units
        if intensity is not None and room:
            intensity = np.concatenate((np.empty(room, np.uint8), intensity))
        return angle, distance, intensity

    def _remember(self, capsules: Capsules, distance: Floats) -> None:  # noqa: B027 - most formats need nothing
        """Keep what the next packets need of these."""

    @abstractmethod
    def _payload(self, capsules: Capsules, distance: Floats, angle: Floats) -> Bytes | None:
        """Write distances in mm, take corrections off the angles, both (packets, samples); return intensities."""

    def _bring_into_turn(self, angle: Floats, starts: Ints, arc: Ints | NDArray[np.float64]) -> None:
        """Take 360 degrees off the angles of those few packets that may lie across 0."""
        back, ahead = self.reach
        full_turn = FULL_TURN_Q6 * self.samples
        for beyond in _stretches(starts > FULL_TURN_Q6 - ahead - arc.max()):
            few = angle[beyond]
            np.subtract(few, full_turn, out=few, where=few >= full_turn)
        if back:
            for behind in _stretches(starts < back):
                in_turn(angle[behind], full_turn)

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
    reach: ClassVar[tuple[int, int]] = (8 << 6, 0)

    def _payload(self, capsules: Capsules, distance: Floats, angle: Floats) -> None:
        millimetres, eighths = express_cabins(np.ascontiguousarray(capsules.words[:, 2:]))
        distance[...] = millimetres.reshape(distance.shape)
        angle -= eighths.reshape(angle.shape) * np.float32(self._units / 8)


class UltraDecoder(CapsuleDecoder):
    """0x84: scaled and predicted distances; the angle is corrected by the distance."""

    size: ClassVar[int] = UltraFormat.shortest
    samples: ClassVar[int] = 96
    reach: ClassVar[tuple[int, int]] = (8 << 6, 30 << 6)

    def __init__(self) -> None:
        super().__init__()
        self._corrections = near_range_corrections(self._units)

    def _payload(self, capsules: Capsules, distance: Floats, angle: Floats) -> None:
        after = capsules.after
        cabins = np.ascontiguousarray(capsules.words[:, 2:]).view("<u4").astype(np.intp)
        follower = None if after is None else int(after[2]) | int(after[3]) << 16
        ultra_cabins(cabins, follower, capsules.missing, distance)
        angle -= self._corrections.take(distance.astype(np.intp))


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
        distance /= 4.0
        return intensity

    def _remember(self, capsules: Capsules, distance: Floats) -> None:
        """As `CapsuleDecoder._remember`: the last distance, for the smoothing of the next one."""
        missing_behind = capsules.missing is not None and capsules.missing[-1] > 0
        self._last_q2 = 0 if missing_behind else int(distance[-1] * 4)


class HqDecoder:
    """0x83: whole nodes, passed through."""

    samples = 96

    def __init__(self) -> None:
        self._rotation = Rotation(FULL_TURN_Q14)

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        """As `Decoder.decode`."""
        nodes, first, inside = self._read(packets)
        after = None if following is None else self._first_angle(following)
        arcs = self._rotation.arcs_told(first, after, inside)
        angle, distance, intensity = self._samples_of(nodes, room)
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            before_seam=nodes.size if seam is None else nodes.size - self._behind_seam(nodes["angle"][-1], seam),
            ends=range(self.samples, nodes.size + 1, self.samples),
            lost=arcs.lost,
            unbroken=arcs.unbroken,
            lost_behind=arcs.lost_behind,
            revolution_packets=FULL_TURN_Q14 / arcs.typical if arcs.typical else 0.0,
            revolution_samples=FULL_TURN_Q14 / arcs.typical * self.samples if arcs.typical else 0.0,
            certain=arcs.certain,
        )

    def decode_steady(
        self, packets: Packets, following: bytes, ends: Sequence[int], room: int = 0, seam: int | None = None
    ) -> SteadySamples | None:
        """As `Decoder.decode_steady`."""
        nodes, first, inside = self._read(packets)
        arcs = self._rotation.steady_told(first, self._first_angle(following), inside, ends)
        if arcs is None:
            return None
        angle, distance, intensity = self._samples_of(nodes, room)
        packet_ends = [end * self.samples for end in ends]
        return SteadySamples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            packet_ends=packet_ends,
            before_seam=packet_ends
            if seam is None
            else [end * self.samples - self._behind_seam(nodes["angle"][end - 1], seam) for end in ends],
            revolution_packets=[FULL_TURN_Q14 / each for each in arcs],
            revolution_samples=[FULL_TURN_Q14 / each * self.samples for each in arcs],
            settle=partial(self._rotation.settle_told, arcs[-1]),
        )

    def _read(self, packets: Packets) -> tuple[NDArray[np.void], Ints, NDArray[np.float64]]:
        """The nodes, shape (packets, 96), the first angle of each packet, and the way during it."""
        nodes: NDArray[np.void] = np.frombuffer(packets.data, HQ)["nodes"]
        first = nodes["angle"][:, 0].astype(np.int32)
        # From the first of 96 nodes to the last there are 95 steps.
        inside = np.multiply(
            (nodes["angle"][:, -1] - first) % FULL_TURN_Q14, self.samples / (self.samples - 1), dtype=np.float64
        )
        return nodes, first, inside

    @staticmethod
    def _first_angle(packet: bytes) -> int:
        return int(np.frombuffer(packet, HQ)["nodes"]["angle"][0, 0])

    @staticmethod
    def _samples_of(nodes: NDArray[np.void], room: int) -> tuple[Floats, Floats, Bytes]:
        """Degrees, millimetres and intensities of all nodes, behind `room` free places."""
        angle, distance, intensity = _empty(room + nodes.size)
        angle[room:].reshape(nodes.shape)[...] = nodes["angle"]
        distance[room:].reshape(nodes.shape)[...] = nodes["distance"]
        intensity[room:].reshape(nodes.shape)[...] = nodes["quality"]
        angle[room:] *= 360.0 / FULL_TURN_Q14
        distance[room:] /= 4.0
        return angle, distance, intensity

    @staticmethod
    def _behind_seam(angles: Words, seam: int) -> int:
        """How many nodes of one packet, which all lie ahead of its first one, are behind the seam."""
        ahead = angles.astype(np.int64) - int(angles[0])
        ahead[ahead < -FULL_TURN_Q14 // 2] += FULL_TURN_Q14
        return int(np.count_nonzero(ahead >= FULL_TURN_Q14 - (int(angles[0]) - seam) % FULL_TURN_Q14))


class NodeDecoder:
    """0x81: the plain node."""

    def __init__(self) -> None:
        # Nodes carry corrected angles, which scatter by most of a step: only a doubled step is a lost node.
        # Without a check value, a few bytes may pass for nodes that are up to 30 degrees ahead.
        self._rotation = Rotation(FULL_TURN_Q6, jitter=0.75, retreat=1 / 12)

    def decode(
        self,
        packets: Packets,
        following: bytes | None,
        room: int = 0,
        seam: int | None = None,  # noqa: ARG002 - a node is too short to lie across it
    ) -> Samples:
        """As `Decoder.decode`."""
        rows, angles = self._read(packets)
        arcs = self._rotation.arcs(angles, None if following is None else self._angle(following))
        angle, distance, intensity = self._samples_of(rows, angles, room)
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            before_seam=len(rows),
            ends=range(1, len(rows) + 1),
            lost=arcs.lost,
            unbroken=arcs.unbroken,
            lost_behind=arcs.lost_behind,
            revolution_packets=FULL_TURN_Q6 / arcs.typical if arcs.typical else 0.0,
            revolution_samples=FULL_TURN_Q6 / arcs.typical if arcs.typical else 0.0,
            certain=arcs.certain,
        )

    def decode_steady(
        self,
        packets: Packets,
        following: bytes,
        ends: Sequence[int],
        room: int = 0,
        seam: int | None = None,  # noqa: ARG002 - a node is too short to lie across it
    ) -> SteadySamples | None:
        """As `Decoder.decode_steady`."""
        rows, angles = self._read(packets)
        arcs = self._rotation.steady(angles, self._angle(following), ends)
        if arcs is None:
            return None
        angle, distance, intensity = self._samples_of(rows, angles, room)
        a_revolution = [FULL_TURN_Q6 / each for each in arcs.typical]
        return SteadySamples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            packet_ends=ends,
            before_seam=ends,
            revolution_packets=a_revolution,
            revolution_samples=a_revolution,
            settle=partial(self._rotation.settle, arcs),
        )

    @staticmethod
    def _read(packets: Packets) -> tuple[NDArray[np.void], Ints]:
        rows: NDArray[np.void] = np.frombuffer(packets.data, NODE)
        return rows, (rows["angle"] >> 1).astype(np.int32)

    @staticmethod
    def _angle(node: bytes) -> int:
        return node[1] >> 1 | node[2] << 7

    @staticmethod
    def _samples_of(rows: NDArray[np.void], angles: Ints, room: int) -> tuple[Floats, Floats, Bytes]:
        """Degrees, millimetres and intensities of all nodes, behind `room` free places."""
        angle, distance, intensity = _empty(room + len(rows))
        np.divide(angles, 64.0, out=angle[room:], dtype=np.float32, casting="same_kind")
        distance[room:] = rows["distance"]
        distance[room:] /= 4.0
        np.bitwise_and(rows["quality"], 0xFC, out=intensity[room:])
        return angle, distance, intensity


def _empty(size: int) -> tuple[Floats, Floats, Bytes]:
    """Angles, distances and intensities, to be filled."""
    return np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.uint8)


def _stretches(these: NDArray[np.bool_]) -> list[slice]:
    """These packets, as stretches of such that follow each other; one or none in each revolution."""
    places = these.nonzero()[0]
    if not len(places):
        return []
    first, last = int(places[0]), int(places[-1])
    if last - first < len(places):
        return [slice(first, last + 1)]
    parts = (np.flatnonzero(places[1:] - places[:-1] > 1) + 1).tolist()
    return [slice(int(places[a]), int(places[b - 1]) + 1) for a, b in pairwise([0, *parts, len(places)])]


def _in_range(starts: Ints) -> Ints:
    """Start angles without the flag beside them, below 360 degrees; mostly they are so already."""
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
