"""Packets, records and noise of the stream of a 4ROS, through a real `Link`."""

from random import Random

import pytest

from lidario.families.ydlidar.decode import KINDS
from lidario.families.ydlidar.formats import FULL_TURN_Q6, PointCloud
from lidario.families.ydlidar.simulated.packers import pack_points, start_control
from lidario.wire.blocks import packet_offsets
from lidario.wire.formats import BEGINS, NO_PACKET
from tests.families.ydlidar.about import CASES
from tests.support.streams import Received, feed, in_one_run

FOUR_ROS = next(case for case in CASES if case.name == "ydlidar_4ros_wrap")


def in_any_pieces(raw: bytes) -> Received:
    """What a link makes of a stream, and proof that it does not depend on the pieces."""
    whole = feed(FOUR_ROS, raw)
    for size in (1, 2, 3, 8, 64, 997):
        assert feed(FOUR_ROS, raw, size) == whole, f"in pieces of {size}"
    return whole


def packet(count: int = 40, first: int = 100, *, seed: int = 0) -> bytes:
    random = Random(seed)
    distances = [random.randrange(1, 30_000) for _ in range(count)]
    return pack_points(distances, first, (first + 11 * (count - 1)) % FULL_TURN_Q6)


CLEAN = [packet(first=500 * n, seed=n) for n in range(12)]


@pytest.mark.parametrize("count", [1, 2, 39, 80, 81, 127, 128, 255])
def test_every_length_is_a_packet(count: int) -> None:
    packets = [*CLEAN[:3], packet(count, 2000), *CLEAN[3:]]
    received = in_any_pieces(b"".join(packets))
    assert received.data == b"".join(packets)
    assert received.stats.skipped_bytes == 0


def test_headings_and_offsets() -> None:
    start = pack_points([700], 22739, 22739, control=start_control(10.0))
    packets = [packet(39, 22290), start, packet(40, 22751), packet(1, 160), packet(2, FULL_TURN_Q6)]
    wire, raw = PointCloud(), b"".join(packets)
    parsed = in_one_run(wire, raw)
    # One sample that begins nothing is the last of its revolution: 2 degrees earlier it passes no seam.
    assert list(wire.headings(parsed)) == [22290, 22739 | BEGINS, 22751, 160 - 128, 0]
    assert list(packet_offsets(parsed.blocks)) == [0, 88, 100, 190, 202, len(raw)]


@pytest.mark.parametrize("behind", [0, 1, 11])
def test_the_first_packet_after_noise_is_not_kept_waiting(behind: int) -> None:
    for noise in (b"\x00", CLEAN[0][:50], CLEAN[0][:-1] + b"\xff"):
        received = in_any_pieces(noise + CLEAN[1] + CLEAN[2][:behind])
        assert received.data == CLEAN[1]


def test_a_packet_whose_mark_is_damaged_as_its_check_value_is_none() -> None:
    odd = bytearray(CLEAN[5])
    odd[0] ^= 1
    odd[8] ^= 1
    assert feed(FOUR_ROS, b"".join([*CLEAN[:5], odd])).data == b"".join(CLEAN[:5])


@pytest.mark.parametrize("kind", KINDS)
def test_no_claimed_size_is_beyond_the_longest(kind: str) -> None:
    """Of more than 80 samples only what has the check bits of both angles, and never of none."""
    wire = KINDS[kind].wire()
    claimed = {
        (count, bits): wire.measure(bytearray((0xAA, 0x55, 0, count, bits, 0, bits, 0)), 0)
        for count in range(256)
        for bits in (0, 1)
    }
    sizes = {size for size in claimed.values() if size != NO_PACKET}
    assert (min(sizes), max(sizes)) == (wire.shortest, wire.longest)
    each = KINDS[kind].wire.sample_size
    assert all(
        size == (10 + each * count if count and (bits or count <= 80) else NO_PACKET)
        for (count, bits), size in claimed.items()
    )
