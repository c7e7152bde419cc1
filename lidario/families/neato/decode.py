"""The packets of one stretch of stream, decoded at once into arrays, as `lidario.families.arcs` tells.

A sample stands at a whole degree, counted in the sense in which the rotor turns: counter-clockwise in an XV-11 (the
viewer in Xevel/NXV11 plots it so), clockwise in the others. Weak returns are delivered: in the recording their
distances are as plausible as those of others, at a fifth of the strength. Strengths are divided by 8, so that 2040
is the largest one that is told; 1202 is the largest one in the recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from lidario.families.arcs import ArcDecoder, Decoded
from lidario.families.neato.formats import FIRST, FULL_TURN, PACKET, PACKETS, SAMPLES
from lidario.families.slots import SlotWheel
from lidario.families.spans import Arcs, Heads
from lidario.wire.events import Packets

__all__ = ["BackDecoder", "PacketDecoder", "rpm_of"]

_NONE: Final = 0x8000
_MILLIMETRES: Final = 0x3FFF


class PacketDecoder(ArcDecoder):
    """Decodes the packets of one stream of a rotor that turns clockwise."""

    by_angle = True

    def __init__(self) -> None:
        super().__init__(FULL_TURN, SlotWheel(FULL_TURN, PACKETS))

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        rows = np.frombuffer(packets.data, PACKET)
        after = None if following is None else (following[1] - FIRST) * SAMPLES
        return Heads((rows["number"].astype(np.int32) - FIRST) * SAMPLES, after, SAMPLES, None, rows)

    def _samples(
        self,
        packets: Packets,  # noqa: ARG002
        heads: Heads,
        arcs: Arcs,  # noqa: ARG002
        ends: Sequence[int],
        room: int,
    ) -> Decoded:
        size = room + ends[-1]
        angle, distance = np.empty(size, np.float32), np.empty(size, np.float32)
        intensity = np.empty(size, np.uint8)
        measured, rows = heads.read["samples"], (-1, SAMPLES)
        words = measured["distance"]
        distance[room:].reshape(rows)[...] = np.where(words & _NONE, 0, words & _MILLIMETRES)
        intensity[room:].reshape(rows)[...] = np.minimum(measured["strength"] >> 3, 255)
        angle[room:].reshape(rows)[...] = self._clockwise(heads.first[:, None] + np.arange(SAMPLES))
        return Decoded(angle, distance, intensity)

    def _clockwise(self, turned: np.ndarray) -> np.ndarray:
        return turned

    def _reported_rpm(self, heads: Heads, begin: int, end: int) -> float:
        return float(heads.read["speed"][begin:end].mean()) / 64


class BackDecoder(PacketDecoder):
    """Decodes the packets of one stream of an XV-11, which turns counter-clockwise."""

    def _clockwise(self, turned: np.ndarray) -> np.ndarray:
        return -turned % FULL_TURN


def rpm_of(packets: bytes) -> float:
    """The speed that packets tell, revolutions a minute."""
    return float(np.median(np.frombuffer(packets, PACKET)["speed"])) / 64
