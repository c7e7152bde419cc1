"""The decoders of the two formats that hold whole nodes, 0x81 and 0x83: each sample has an angle of its own."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Output
from lidario.families.rplidar.formats import FULL_TURN_Q6, FULL_TURN_Q14, HQ
from lidario.families.rplidar.node_steps import NodeSteps
from lidario.families.rplidar.nodes import NODE
from lidario.families.spans import Arcs, Heads
from lidario.families.told import ToldWheel
from lidario.wire.events import Packets

FIRST_ANGLE: Final = 9
"""Offset of the first node's angle in a packet of 0x83."""


class HqDecoder(ArcDecoder):
    """0x83: whole nodes, passed through."""

    samples = 96

    def __init__(self) -> None:
        super().__init__(FULL_TURN_Q14, ToldWheel(FULL_TURN_Q14, self.samples / 2))

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        nodes: NDArray[np.void] = np.frombuffer(packets.data, HQ)["nodes"]
        angles = nodes["angle"]
        after = None if following is None else following[FIRST_ANGLE] | following[FIRST_ANGLE + 1] << 8
        # Without a sign, 16 bits hold just 360 degrees.
        way = (angles[:, -1] - angles[:, 0]).astype(np.int32)
        return Heads(angles[:, 0].astype(np.int32), after, self.samples, way, nodes)

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:  # noqa: ARG002 - nodes are not moved
        nodes = heads.read
        np.multiply(nodes["angle"], np.float32(360.0 / FULL_TURN_Q14), out=output.angle)
        np.multiply(nodes["distance"], 0.25, out=output.distance, dtype=np.float32, casting="same_kind")
        output.intensity[...] = nodes["quality"]

    def _behind_seam(self, heads: Heads, arcs: Arcs, at: int, seam: int) -> int:  # noqa: ARG002
        """How many nodes of a packet, which all lie ahead of its first one, are behind the seam."""
        angles = heads.read["angle"][at]
        left = FULL_TURN_Q14 - (int(angles[0]) - seam) % FULL_TURN_Q14
        if left >= FULL_TURN_Q14 // 2:
            return 0
        # Without a sign, 16 bits hold just 360 degrees: what is not yet at the seam is far ahead of it.
        beyond = angles - np.uint16(seam)
        return int(np.count_nonzero(beyond < FULL_TURN_Q14 // 2 - left))


class NodeDecoder(ArcDecoder):
    """0x81: the plain node."""

    def __init__(self) -> None:
        super().__init__(FULL_TURN_Q6, NodeSteps(FULL_TURN_Q6))

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        rows: NDArray[np.void] = np.frombuffer(packets.data, NODE)
        after = None if following is None else following[1] >> 1 | following[2] << 7
        return Heads((rows["angle"] >> 1).astype(np.int32), after, 1, None, rows)

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:  # noqa: ARG002 - nodes are not moved
        rows, distance = heads.read, output.distance[:, 0]
        np.divide(heads.first, 64.0, out=output.angle[:, 0], dtype=np.float32, casting="same_kind")
        distance[...] = rows["distance"]
        distance *= 0.25
        np.bitwise_and(rows["quality"], 0xFC, out=output.intensity[:, 0])

    def _behind_seam(self, heads: Heads, arcs: Arcs, at: int, seam: int) -> int:  # noqa: ARG002
        """None: a node is too short to lie across it."""
        return 0
