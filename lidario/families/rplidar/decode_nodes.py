"""The decoders of the two formats that hold whole nodes, 0x81 and 0x83: each sample has an angle of its own."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import partial
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples, SteadySamples
from lidario.families.rplidar.decoded import Decoded, Ints, Words, decoded_samples, decoded_steady
from lidario.families.rplidar.formats import FULL_TURN_Q6, FULL_TURN_Q14
from lidario.families.rplidar.nodes import NODE
from lidario.families.rplidar.rotation import NodeSteps, ToldArcs
from lidario.wire.events import Packets

__all__ = ["HqDecoder", "NodeDecoder"]

HQ_NODE: Final = np.dtype([("angle", "<u2"), ("distance", "<u4"), ("quality", "u1"), ("flag", "u1")])
HQ: Final = np.dtype([("sync", "u1"), ("time", "<u8"), ("nodes", HQ_NODE, 96), ("crc", "<u4")])
FIRST_ANGLE: Final = 9
"""Offset of the first node's angle in a packet of 0x83."""


class HqDecoder:
    """0x83: whole nodes, passed through."""

    samples = 96

    def __init__(self) -> None:
        # From the first of 96 nodes to the last there are 95 steps.
        self._arcs = ToldArcs(FULL_TURN_Q14, (self.samples - 1) / self.samples)

    def tell_time(self, sample_ns: float) -> None:
        """As `Decoder.tell_time`; packets tell how far the rotor turned."""

    def fork(self) -> Self:
        """As `Decoder.fork`; it remembers nothing."""
        return self

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        """As `Decoder.decode`."""
        nodes, first, inside = self._read(packets)
        after = None if following is None else self._first_angle(following)
        arcs = self._arcs.arcs(first, after, inside)
        before_seam = nodes.size if seam is None else nodes.size - self._behind_seam(nodes["angle"][-1], seam)
        return decoded_samples(self._samples_of(nodes, room), arcs, FULL_TURN_Q14, self.samples, before_seam)

    def decode_steady(
        self, packets: Packets, following: bytes, ends: Sequence[int], room: int = 0, seam: int | None = None
    ) -> SteadySamples | None:
        """As `Decoder.decode_steady`."""
        nodes, first, inside = self._read(packets)
        arcs = self._arcs.steady(first, self._first_angle(following), inside, ends)
        if arcs is None:
            return None
        before_seam = packet_ends = [end * self.samples for end in ends]
        if seam is not None:
            angles = nodes["angle"]
            before_seam = [end * self.samples - self._behind_seam(angles[end - 1], seam) for end in ends]
        return decoded_steady(
            self._samples_of(nodes, room),
            arcs,
            FULL_TURN_Q14,
            packet_ends,
            self.samples,
            before_seam,
            settle=lambda: None,  # each packet tells its own arc
        )

    def _read(self, packets: Packets) -> tuple[NDArray[np.void], Ints, Words]:
        """The nodes, shape (packets, 96), the first angle of each packet, and the way to its last one."""
        nodes: NDArray[np.void] = np.frombuffer(packets.data, HQ)["nodes"]
        angles = nodes["angle"]
        first = angles[:, 0].astype(np.int32)
        # Without a sign, 16 bits hold just 360 degrees.
        return nodes, first, angles[:, -1] - angles[:, 0]

    @staticmethod
    def _first_angle(packet: bytes) -> int:
        return packet[FIRST_ANGLE] | packet[FIRST_ANGLE + 1] << 8

    @staticmethod
    def _samples_of(nodes: NDArray[np.void], room: int) -> Decoded:
        """Degrees, millimetres and intensities of all nodes, behind `room` free places."""
        size = room + nodes.size
        angle, distance = np.empty(size, np.float32), np.empty(size, np.float32)
        intensity = np.empty(size, np.uint8)
        angle[room:].reshape(nodes.shape)[...] = nodes["angle"]
        distance[room:].reshape(nodes.shape)[...] = nodes["distance"]
        intensity[room:].reshape(nodes.shape)[...] = nodes["quality"]
        angle[room:] *= 360.0 / FULL_TURN_Q14
        distance[room:] *= 0.25
        return Decoded(angle, distance, intensity)

    @staticmethod
    def _behind_seam(angles: Words, seam: int) -> int:
        """How many nodes of one packet, which all lie ahead of its first one, are behind the seam."""
        first = int(angles[0])
        left = FULL_TURN_Q14 - (first - seam) % FULL_TURN_Q14
        if left >= FULL_TURN_Q14 // 2:
            return 0
        # Without a sign, 16 bits hold just 360 degrees: what is not yet at the seam is far ahead of it.
        beyond = angles - np.uint16(seam)
        return int(np.count_nonzero(beyond < FULL_TURN_Q14 // 2 - left))


class NodeDecoder:
    """0x81: the plain node."""

    def __init__(self) -> None:
        self._steps = NodeSteps(FULL_TURN_Q6)

    def tell_time(self, sample_ns: float) -> None:
        """As `Decoder.tell_time`; the steps of nodes tell how far the rotor turned."""

    def fork(self) -> Self:
        """As `Decoder.fork`."""
        twin = copy.copy(self)
        twin._steps = self._steps.fork()  # noqa: SLF001 - its own
        return twin

    def decode(
        self,
        packets: Packets,
        following: bytes | None,
        room: int = 0,
        seam: int | None = None,  # noqa: ARG002 - a node is too short to lie across it
    ) -> Samples:
        """As `Decoder.decode`."""
        rows, angles = self._read(packets)
        arcs = self._steps.arcs(angles, None if following is None else self._angle(following))
        return decoded_samples(self._samples_of(rows, angles, room), arcs, FULL_TURN_Q6, 1, len(rows))

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
        arcs = self._steps.steady(angles, self._angle(following), ends)
        if arcs is None:
            return None
        decoded = self._samples_of(rows, angles, room)
        return decoded_steady(decoded, arcs.typical, FULL_TURN_Q6, ends, 1, ends, partial(self._steps.settle, arcs))

    @staticmethod
    def _read(packets: Packets) -> tuple[NDArray[np.void], Ints]:
        rows: NDArray[np.void] = np.frombuffer(packets.data, NODE)
        return rows, (rows["angle"] >> 1).astype(np.int32)

    @staticmethod
    def _angle(node: bytes) -> int:
        return node[1] >> 1 | node[2] << 7

    @staticmethod
    def _samples_of(rows: NDArray[np.void], angles: Ints, room: int) -> Decoded:
        """Degrees, millimetres and intensities of all nodes, behind `room` free places."""
        size = room + len(rows)
        angle, distance = np.empty(size, np.float32), np.empty(size, np.float32)
        intensity = np.empty(size, np.uint8)
        np.divide(angles, 64.0, out=angle[room:], dtype=np.float32, casting="same_kind")
        distance[room:] = rows["distance"]
        distance[room:] *= 0.25
        np.bitwise_and(rows["quality"], 0xFC, out=intensity[room:])
        return Decoded(angle, distance, intensity)
