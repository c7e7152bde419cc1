"""The frames of one stretch of stream, decoded at once into arrays, as `lidario.families.arcs` tells.

The samples of a frame divide its part of the revolution evenly, clockwise (3irobotix's specification): the angle of
sample i of N is start + i * 360 / (16 N) degrees, 15 for a Delta-2G. So how long one takes follows from the speed.
"""

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import Output
from lidario.families.irobotix.formats import (
    FULL_TURN,
    FifteenFormat,
    FrameFormat,
    frames_in,
    frames_of,
    samples_of,
)
from lidario.families.slots import SlotDecoder
from lidario.families.spans import Arcs, Heads
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets


class FrameDecoder(SlotDecoder):
    """Decodes the frames of one stream; `wire` is their format."""

    def __init__(self, wire: type[FrameFormat]) -> None:
        super().__init__(FULL_TURN, wire.frames)

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        first, counts, speeds = frames_of(packets.data, packet_offsets(packets.blocks))
        after = None if following is None else int(frames_of(following, (0, len(following)))[0][0])
        return Heads(first, after, counts, None, (packets, speeds))

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:  # noqa: ARG002 - equal parts of a revolution
        packets: Packets = heads.read[0]
        raw = np.frombuffer(packets.data, np.uint8)
        at = place = packet = 0
        for frame, count in packets.blocks:
            each = samples_of(frame)
            until, behind = at + each * count, place + frame * count
            measured = raw[place:behind].reshape(count, frame)[:, -2 - 3 * each : -2].reshape(count, each, 3)
            output.intensity[at:until].reshape(count, each)[...] = measured[:, :, 0]
            quarters = measured[:, :, 1].astype(np.uint16) << 8 | measured[:, :, 2]
            np.divide(quarters, 4, out=output.distance[at:until].reshape(count, each), casting="same_kind")
            # In parts of a sample, whole numbers below 2^24, so that the division alone rounds; never up
            # to 360 degrees, of which every angle is at least 15 such parts below.
            parts = self._slots * each
            first = heads.first[packet : packet + count, None] * np.int64(parts)
            beam = (first + np.arange(each) * FULL_TURN) % (FULL_TURN * parts)
            output.angle[at:until].reshape(count, each)[...] = beam / (100.0 * parts)
            at, place, packet = until, behind, packet + count

    def _revolution_packets(self, heads: Heads, samples: float, begin: int, end: int) -> float:  # noqa: ARG002
        return float(self._slots)

    def _rpm(self, heads: Heads) -> NDArray[np.float64]:
        speeds: NDArray[np.uint8] = heads.read[1]
        return speeds * np.float64(3.0)


def frames_a_turn(packets: bytes) -> int:
    """How many frames a revolution has, by how far some of them are apart; slots are counted from angle 0."""
    apart = np.diff(frames_in(packets)[0], prepend=0) % FULL_TURN
    # By which number the ways between them are nearest to whole slots.
    slots = {frames: FULL_TURN // frames for frames in (FrameFormat.frames, FifteenFormat.frames)}
    return min(slots, key=lambda frames: int(np.minimum(apart % slots[frames], -apart % slots[frames]).sum()))
