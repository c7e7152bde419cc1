"""The scalar references, and what tests damage streams with.

`tests.test_golden` compares the samples of the references: with what lidario decodes, which is compared with the
vendors'. Here is what is beyond the golden streams: angles of RPLIDAR against the vendor's, the rest by hand.
"""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from tests.reference import golden, rplidar, ydlidar
from tests.reference.samples import Sample, revolutions
from tests.support.cases import KINDS, Case, named


@pytest.mark.parametrize("case", KINDS, ids=named)
def test_a_reference_refuses_a_damaged_packet(case: Case) -> None:
    """So what it splits is intact: other tests rely on that."""
    raw = bytearray(b"".join(case.packets[:3]))
    first, second = map(len, case.packets[:2])
    # A plain node has nothing but its two check bits.
    raw[first + (second // 2 if second > 5 else 0)] ^= 0x11
    with pytest.raises(ValueError, match=r"packet|byte|stream"):
        case.split(bytes(raw))


@pytest.mark.parametrize("name", golden.names_of("ydlidar_4ros"))
def test_ydlidar_revolutions(name: str) -> None:
    stream = golden.load(name)
    assert stream.scan is not None
    samples = ydlidar.decode(ydlidar.split(stream.raw))
    turns = ydlidar.revolutions(samples)
    assert [len(turn) for turn in turns] == np.bincount(stream.scan).tolist()
    assert [sample for turn in turns for sample in turn] == samples[: len(stream.scan)]
    assert all(turn[0].start and not turn[1].start for turn in turns)
    # Joined in the middle of a turn, the rest of that turn is left out.
    assert ydlidar.revolutions(samples[1:]) == turns[1:]


@cache
def rplidar_stream(name: str) -> tuple[golden.Golden, int, list[bytes], list[Sample]]:
    stream = golden.load(name)
    assert stream.response_type is not None
    packets = rplidar.split(stream.response_type, stream.raw)
    return stream, stream.response_type, packets, rplidar.decode(stream.response_type, packets)


@pytest.mark.exhaustive("name", sample=golden.names_of("rplidar"))
def test_rplidar_revolutions(name: str) -> None:
    """The vendor marks the first sample past 0° in 0x81 and 0x83, in capsules the last one before it."""
    stream, response_type, _, samples = rplidar_stream(name)
    assert stream.start is not None
    late = 1 if response_type in rplidar.CAPSULE_TYPES else 0
    cuts = [int(index) + late for index in np.flatnonzero(stream.start)]
    assert len(cuts) > 2
    turns = revolutions(samples)
    assert turns == [samples[begin:end] for begin, end in pairwise(cuts)]


def capsule(response_type: int, start_q6: int, body: bytes = b"", reset: bool = False) -> bytes:
    """A capsule with the given bytes behind its start angle, zeros after them."""
    offset = rplidar.START_OFFSET[response_type]
    head = bytes(offset - 2) + (start_q6 | (0x8000 if reset else 0)).to_bytes(2, "little")
    rest = (head + body).ljust(rplidar.PACKET_BYTES[response_type] - 2, b"\0")
    check = 0
    for byte in rest:
        check ^= byte
    packet = bytes([0xA0 | check & 0x0F, 0x50 | check >> 4]) + rest
    assert rplidar.split(response_type, packet) == [packet]
    return packet


@pytest.mark.parametrize("response_type", rplidar.CAPSULE_TYPES)
def test_capsule_before_a_reset_is_dropped(response_type: int) -> None:
    packets = [capsule(response_type, 0, reset=True), capsule(response_type, 640)] * 2
    assert {sample.packet for sample in rplidar.decode(response_type, packets)} == {0, 2}


def test_82_offsets_cross_zero_and_are_unsigned() -> None:
    body = (1000 << 2 | 1).to_bytes(2, "little") + (16383 << 2 | 3).to_bytes(2, "little") + b"\xf1"
    samples = rplidar.decode(0x82, [capsule(0x82, 64, body), capsule(0x82, 64 + 32 * 64)])
    first, second = samples[:2]
    assert (first.raw_deg, first.angle_deg, first.distance_mm) == (1.0, 1.0 - 17 / 8 + 360.0, 1000.0)
    assert (second.raw_deg, second.angle_deg, second.distance_mm) == (2.0, 2.0 - 63 / 8 + 360.0, 16383.0)


def distances_84(cabin: tuple[int, int, int], next_major: int) -> list[float]:
    """Distances of the last cabin of a packet: its neighbour is in the packet after it."""
    major, predict1, predict2 = cabin
    word = major | (predict1 & 0x3FF) << 12 | (predict2 & 0x3FF) << 22
    packets = [
        capsule(0x84, 0, bytes(31 * 4) + word.to_bytes(4, "little")),
        capsule(0x84, 640, next_major.to_bytes(4, "little")),
    ]
    return [sample.distance_mm for sample in rplidar.decode(0x84, packets)[93:96]]


@pytest.mark.parametrize(
    ("cabin", "next_major", "expected"),
    [
        ((511, 1, -1), 511, [511, 512, 510]),
        ((512, 1, -1), 1279, [512, 514, 2044]),
        ((1280, 1, -1), 1791, [2048, 2052, 4088]),
        ((1792, 1, -1), 3327, [4096, 4104, 16368]),
        ((3328, 1, -1), 4095, [16384, 16400, 28640]),
        ((100, 510, -511), 600, [100, 610, 0]),  # 688 - 1022 mm is less than nothing
        ((100, -512, 511), 600, [100, 0, 0]),
        ((100, 511, -512), 600, [100, 0, 0]),
        ((0, 3, 3), 600, [0, 694, 694]),  # no major of its own: the neighbour's, with its level
        ((100, 3, 3), 0, [100, 103, 3]),
    ],
)
def test_84_distances(cabin: tuple[int, int, int], next_major: int, expected: list[int]) -> None:
    assert distances_84(cabin, next_major) == expected


@pytest.mark.parametrize(
    ("coded", "distance_mm", "behind_q16"),
    [
        # Worked by hand from radians in 1/65536: 9150 is 8°, 8578 is 7.5°; k2 = 98361 / (4 * distance).
        (0, 0, 8578),
        (49, 49, 8578),
        (50, 50, 9150 - (491 << 6) - 1204),  # k2 491: the target is ahead of the beam
        (756, 1000, 9150 - (24 << 6) - 0),  # k2 24
        (3554, 20000, 9150 - (1 << 6) - 0),  # k2 1
    ],
)
def test_84_correction(coded: int, distance_mm: int, behind_q16: int) -> None:
    packets = [capsule(0x84, 90 * 64, coded.to_bytes(4, "little")), capsule(0x84, 91 * 64)]
    sample = rplidar.decode(0x84, packets)[0]
    assert sample.distance_mm == distance_mm
    assert sample.raw_deg == 90
    assert sample.angle_deg == pytest.approx(90 - np.rad2deg(behind_q16 / 65536), abs=1 / 65536)


def bodies_86(words: Sequence[int]) -> bytes:
    """Pairs of 20-bit words as cabins."""
    body = b""
    for first, second in zip(words[::2], words[1::2], strict=True):
        body += (first & 0xFFFF).to_bytes(2, "little") + (second & 0xFFFF).to_bytes(2, "little")
        body += bytes([first >> 16 | second >> 16 << 4])
    return body


def decode_86(words: Sequence[int]) -> list[tuple[float, int | None]]:
    samples = rplidar.decode(0x86, [capsule(0x86, 0, bodies_86(words)), capsule(0x86, 640)])
    return [(sample.distance_mm, sample.quality) for sample in samples[: len(words)]]


def test_86_scales() -> None:
    words = [
        0xAB << 12 | 0x3FF << 2 | 0,
        0x55 << 13 | 0x7FF << 2 | 1,
        0x2A << 14 | 0xFFF << 2 | 2,
        0x15 << 15 | 0x1FFF << 2 | 3,
    ]
    assert decode_86(words) == [(2046, 0xAB), (8187, 0xAA), (24567, 0xA8), (65522, 0xA8)]


def test_86_smoothing() -> None:
    """Against the last output, not the last input; within 2 mm; after a return; in the near scale alone."""
    near = [100 << 2, 101 << 2, 102 << 2, 0, 1 << 2, 50 << 2]
    assert [distance for distance, _ in decode_86(near)] == [200, 201, 204, 0, 2, 100]
    # 2046 mm in the second scale, 2044 mm in the first, 2046 mm in the second again
    assert [distance for distance, _ in decode_86([1, 1022 << 2, 1, 0])] == [2046, 2045, 2046, 0]
