"""The shared decoder of packets that state their first and last angle, with a format that no family has."""

from __future__ import annotations

import math

import numpy as np

from lidario.families.arcs import ArcDecoder, Output
from lidario.families.spans import Arcs, Heads
from lidario.families.told import ToldWheel
from lidario.wire.blocks import Block
from lidario.wire.events import Packets

PACKET = np.dtype([("start", "<u2"), ("distance", "<u2", 8), ("end", "<u2")])
STEP = 100


FULL_TURN = 360 * 64


class ToyDecoder(ArcDecoder):
    """Eight samples, 1/64 degrees, no speed and no intensity."""

    has_intensity = False

    def __init__(self) -> None:
        super().__init__(FULL_TURN, ToldWheel(FULL_TURN, 4))

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        rows = np.frombuffer(packets.data, PACKET)
        first = rows["start"].astype(np.int32)
        behind = None if following is None else int(np.frombuffer(following, PACKET)["start"][0])
        return Heads(first, behind, 8, (rows["end"] - first) % FULL_TURN, rows)

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:
        output.angle[...] = (heads.first[:, None] + arcs.arc[:, None] * np.arange(8) / 7) / 64 % 360
        output.distance[...] = heads.read["distance"]


def packets(count: int, first: int = 0) -> bytes:
    rows = np.zeros(count, PACKET)
    rows["start"] = (first + np.arange(count) * 8 * STEP) % FULL_TURN
    rows["end"] = (rows["start"].astype(np.int32) + 7 * STEP) % FULL_TURN
    rows["distance"] = 1000 + np.arange(8)
    return rows.tobytes()


def run_of(raw: bytes) -> Packets:
    return Packets(raw, (Block(PACKET.itemsize, len(raw) // PACKET.itemsize),), ())


def test_samples_lie_at_equal_steps_across_zero() -> None:
    raw = packets(29)
    found = ToyDecoder().decode(run_of(raw[: 28 * PACKET.itemsize]), raw[28 * PACKET.itemsize :])
    wanted = (np.arange(28 * 8) * STEP / 64) % 360
    np.testing.assert_allclose(found.angle_deg, wanted, atol=2e-5)
    assert found.distance_mm[:9].tolist() == [*range(1000, 1008), 1000]
    assert found.intensity is None
    assert math.isnan(found.reported_rpm)
    assert found.revolution_samples == 360 * 64 / STEP
    assert (found.lost, list(found.gaps)) == (0, [])


def test_a_gap_is_told_in_packets_and_samples() -> None:
    size = PACKET.itemsize
    raw = packets(12)
    found = ToyDecoder().decode(run_of(raw[: 4 * size] + raw[7 * size :]), None)
    assert (found.lost, found.unbroken, list(found.gaps)) == (3, 4, [(32, 24)])


def test_revolutions_that_are_decoded_together_tell_no_speed_either() -> None:
    size = PACKET.itemsize
    raw = packets(58)
    found = ToyDecoder().decode_steady(run_of(raw[: 57 * size]), raw[57 * size :], (28, 57))
    assert found is not None
    assert found.reported_rpm is not None
    assert all(map(math.isnan, found.reported_rpm))
    assert found.ends == range(8, 57 * 8 + 1, 8)
