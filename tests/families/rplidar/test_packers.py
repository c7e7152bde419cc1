"""The packers of the simulator: against golden streams, the slow reference, and two formats worked out by hand."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lidario.families.rplidar.simulated import packers
from tests.reference import golden, rplidar

Ints = npt.NDArray[np.int64]
metres = st.integers(0, 30_000)


def carried_by_ultra(mm: npt.NDArray[Any], next_mm: float) -> Ints:
    """What is left of distances, shape (packets, 96), by the scalar reference; `next_mm` comes behind them."""
    follower = np.zeros(96)
    follower[0] = next_mm
    starts = 100 + 800 * np.arange(len(mm.reshape(-1, 96)))
    raw = packers.pack_ultra(starts, mm, next_mm) + packers.pack_ultra(10_000, follower)
    return np.array([round(s.distance_mm) for s in rplidar.decode(0x84, rplidar.split(0x84, raw))])


def carried_by_ultra_dense(mm: npt.NDArray[Any], quality: Ints) -> tuple[Ints, Ints]:
    """What is left of the distances and qualities of one packet, by the scalar reference."""
    raw = packers.pack_ultra_dense([0, 64], [mm, mm], [quality, quality])
    decoded = rplidar.decode(0x86, rplidar.split(0x86, raw))
    return np.array([round(s.distance_mm) for s in decoded]), np.array([s.quality for s in decoded])


def test_ultra_by_hand() -> None:
    # 1000 mm: level 1, code 512 + 488 / 2 = 756 = 0x2F4. 1010: from 1000 in steps of 2 = +5.
    # 990: from the next cabin's 1000 in steps of 2 = -5 = 0x3FB.
    mm = np.zeros(96)
    mm[:4] = 1000, 1010, 990, 1000
    packet = packers.pack_ultra(0, mm)
    word = 0x2F4 | 5 << 12 | 0x3FB << 22
    assert packet[4:8] == struct.pack("<I", word)
    # second cabin: nothing after its major: both predictions say "no return" (-512 = 0x200)
    assert packet[8:12] == struct.pack("<I", 0x2F4 | 0x200 << 12 | 0x200 << 22)
    assert packet[12:16] == struct.pack("<I", 0x200 << 12 | 0x200 << 22)
    assert len(packet) == 132


@pytest.mark.parametrize(
    ("mm", "code"),
    [(1, 1), (511, 511), (512, 512), (2048, 1280), (4096, 1792), (16384, 3328), (28656, 4095), (28657, 0)],
)
def test_variable_bit_scale_at_its_borders(mm: int, code: int) -> None:
    samples = np.zeros(96)
    samples[0] = mm
    assert struct.unpack_from("<I", packers.pack_ultra(0, samples), 4)[0] & 0xFFF == code


def test_the_last_cabin_rests_on_the_next_packet() -> None:
    mm = np.zeros(96)
    mm[95] = 5040
    assert carried_by_ultra(mm, 5000)[95] == 5040  # 4096 + 113 * 8 = 5000, and 5 steps of 8
    assert carried_by_ultra(mm, 0)[95] == 0  # beyond ten bits from nothing


def test_ultra_dense_by_hand() -> None:
    mm, quality = np.zeros(64), np.zeros(64, np.int64)
    mm[:2], quality[:2] = (1000, 30000), (200, 175)
    packet = packers.pack_ultra_dense(0x0123, mm, quality, time_us=0x01020304, status=0x0506)
    # 1000 mm: scale 0, 500 steps, quality 200: 200 << 12 | 500 << 2 = 0xC87D0
    # 30000 mm: scale 3, (30000 - 24567) / 5 = 1086.6 -> 1087, quality 175 >> 3 = 21: 21 << 15 | 1087 << 2 | 3
    second = 21 << 15 | 1087 << 2 | 3
    assert packet[2:10] == bytes.fromhex("04030201 0605 2301")
    assert packet[10:15] == struct.pack("<HHB", 0x87D0, second & 0xFFFF, 0xC | (second >> 16) << 4)
    assert packet[15:] == bytes(155)
    got_mm, got_quality = carried_by_ultra_dense(mm, quality)
    assert got_mm[:3].tolist() == [1000, 24567 + 5 * 1087, 0]
    assert got_quality[:3].tolist() == [200, 168, 0]


@pytest.mark.parametrize("rate", ["32k", "9k"])
@pytest.mark.parametrize("kind", range(0x81, 0x87))
def test_golden_streams_are_packed_to_the_same_bytes(rate: str, kind: int) -> None:
    stream = golden.load(f"rplidar_{rate}_{kind:x}")
    packets = rplidar.split(kind, stream.raw)
    if kind in rplidar.CAPSULE_TYPES:
        starts = [rplidar.start_q6(kind, packet) for packet in packets]
        new = rplidar.is_reset(kind, packets[0])
        count = rplidar.PACKET_SAMPLES[kind]
        # The decoder needs a successor: the last packet is not compared.
        distances = np.array([s.distance_mm for s in rplidar.decode(kind, packets)]).reshape(-1, count)
        expected = b"".join(packets[:-1])
    if kind == 0x81:
        samples = rplidar.decode(kind, packets)
        got = packers.pack_standard(
            [round(s.raw_deg * 64) for s in samples],
            [round(s.distance_mm * 4) for s in samples],
            [(s.quality or 0) >> 2 for s in samples],
            [packet[0] & 1 for packet in packets],
        )
        expected = stream.raw
    elif kind == 0x82:
        offsets = [
            (p[4 + 5 * c + 4] >> 4 * h & 15) | (p[4 + 5 * c + 2 * h] & 3) << 4
            for p in packets[:-1] for c in range(16) for h in (0, 1)
        ]  # fmt: skip
        got = packers.pack_express(starts[:-1], distances, offsets, new_stream=new)
    elif kind == 0x83:
        nodes = np.array([struct.unpack("<BQ" + "HIBB" * 96 + "I", p)[2:-1] for p in packets])
        times = [struct.unpack_from("<Q", p, 1)[0] for p in packets]
        got = packers.pack_hq(*(nodes[:, k::4] for k in range(4)), time_us=times)
        expected = stream.raw
    elif kind == 0x84:
        following = struct.unpack_from("<I", packets[-1], 4)[0] & 0xFFF
        got = packers.pack_ultra(starts[:-1], distances, _vbs_mm(following), new_stream=new)
    elif kind == 0x85:
        got = packers.pack_dense(starts[:-1], distances, new_stream=new)
    else:
        words = np.array(
            [
                (struct.unpack_from("<H", p, 10 + 5 * c + 2 * h)[0] | (p[14 + 5 * c] >> 4 * h & 15) << 16)
                for p in packets[:-1] for c in range(32) for h in (0, 1)
            ]
        ).reshape(-1, 64)  # fmt: skip
        scale = words & 3
        steps = words >> 2 & (1 << 10 + scale) - 1
        mm = np.choose(scale, [steps * 2, steps * 3 + 2046, steps * 4 + 8187, steps * 5 + 24567])
        mm = mm + 0.4 * (steps == 0) * (scale > 0)  # 2046 mm can be said in scale 0 and 1: mean the latter
        got = packers.pack_ultra_dense(
            starts[:-1],
            mm,
            words >> 12 + scale << scale,
            time_us=[struct.unpack_from("<I", p, 2)[0] for p in packets[:-1]],
            status=struct.unpack_from("<H", packets[0], 6)[0],
            new_stream=new,
        )
    if kind == 0x84:
        got, expected = _one_mark_for_nothing(got), _one_mark_for_nothing(expected)
    # Not compared as bytes: pytest would work for hours on the difference.
    assert len(got) == len(expected)
    assert np.flatnonzero(np.frombuffer(got, np.uint8) != np.frombuffer(expected, np.uint8)).tolist() == []


def _one_mark_for_nothing(raw: bytes) -> bytes:
    """The bodies of 0x84 packets with 511, which means "no return" as well as -512 does, replaced by that."""
    words = np.frombuffer(raw, "<u4").reshape(-1, 33)[:, 1:].copy()
    for shift in (12, 22):
        words[words >> shift & 0x3FF == 511] ^= (511 ^ 512) << shift
    return words.tobytes()


def _vbs_mm(code: int) -> int:
    return next(
        base + (code - first << shift)
        for first, base, shift in (
            (3328, 16384, 4), (1792, 4096, 3), (1280, 2048, 2), (512, 512, 1), (0, 0, 0),
        )
        if code >= first
    )  # fmt: skip


@given(hnp.arrays(np.int64, (2, 96), elements=metres), metres)
def test_what_ultra_carries_is_close_and_carried_again_unchanged(mm: Ints, next_mm: int) -> None:
    carried = carried_by_ultra(mm, next_mm)
    np.testing.assert_array_equal(carried_by_ultra(carried.reshape(2, 96), next_mm), carried)
    kept = carried > 0
    assert np.all(np.abs(carried - mm.ravel())[kept] <= 8)


def test_ultra_loses_nothing_of_a_smooth_scene() -> None:
    mm = 3000 + 1500 * np.sin(np.arange(192) / 20)
    assert np.abs(carried_by_ultra(mm.reshape(2, 96), 3000) - mm).max() <= 4.5


@given(
    hnp.arrays(np.int64, 64, elements=st.integers(0, 65522)),
    hnp.arrays(np.int64, 64, elements=st.integers(0, 255)),
)
def test_what_ultra_dense_carries_is_close_and_carried_again_unchanged(mm: Ints, quality: Ints) -> None:
    # Far from each other, so that the host's smoothing of short distances does not set in.
    mm[1::2] = np.where(mm[1::2] < 2060, 3000, mm[1::2])
    carried_mm, carried_quality = carried_by_ultra_dense(mm, quality)
    assert np.abs(carried_mm - mm).max() <= 2.5
    assert np.all((quality - carried_quality >= 0) & (quality - carried_quality < 8))
    again = carried_by_ultra_dense(carried_mm, carried_quality)
    np.testing.assert_array_equal(again, (carried_mm, carried_quality))


def test_what_does_not_fit_is_refused_not_wrapped() -> None:
    with pytest.raises(ValueError, match="distance"):
        packers.pack_dense(0, np.full(40, 65536))
    with pytest.raises(ValueError, match="distance"):
        packers.pack_express(0, np.full(32, 16384))
    with pytest.raises(ValueError, match="start angle"):
        packers.pack_dense(0x8000, np.zeros(40))
    with pytest.raises(ValueError, match="quality"):
        packers.pack_standard(0, 0, 64, False)
    with pytest.raises(ValueError, match="reshape"):
        packers.pack_dense(0, np.zeros(39))
