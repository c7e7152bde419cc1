"""Packets, records and noise of the stream of a 4ROS, through a real `Link`."""

from collections.abc import Iterator, Sequence
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.families.ydlidar import commands
from lidario.families.ydlidar.clouds import KINDS
from lidario.families.ydlidar.formats import FULL_TURN_Q6, PointCloud
from lidario.families.ydlidar.simulated.packers import (
    SCAN_HEADER,
    pack_points,
    pack_response,
    pack_time_stamp,
    start_control,
)
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Descriptor, Event, Packets
from lidario.wire.formats import BEGINS, NO_PACKET
from lidario.wire.link import Link, LinkStats
from lidario.wire.states import LinkState
from tests.reference import damage, golden, ydlidar
from tests.support.streams import in_one_run, merged

SIZES = (None, 1, 2, 3, 8, 64, 997)


def pieces(raw: bytes, size: int | None) -> Iterator[bytes]:
    step = size or len(raw) or 1
    for at in range(0, len(raw), step):
        yield raw[at : at + step]


def receive(raw: bytes, size: int | None = None) -> tuple[list[Event], LinkStats]:
    """What a link makes of a stream that comes in pieces of `size` bytes; its descriptor is left out."""
    link = Link()
    link.send_request(commands.scan(PointCloud()))
    events: list[Event] = []
    for piece in pieces(SCAN_HEADER + raw, size):
        link.receive_data(piece, 0)
        events += link.events_received()
    assert link.state is LinkState.STREAMING
    assert events[0] == Descriptor(0x81, 5, continuous=True)
    return merged(events[1:]), link.stats


def kept(events: Sequence[Event]) -> list[bytes]:
    packets: list[bytes] = []
    for event in events:
        if isinstance(event, Packets):
            found = ydlidar.split(event.data)
            assert len(found) == event.count
            packets += found
    return packets


def in_any_pieces(raw: bytes) -> tuple[list[Event], LinkStats]:
    """The same as `receive`, and proof that it does not depend on the pieces."""
    events, stats = receive(raw)
    for size in SIZES[1:]:
        assert receive(raw, size) == (events, stats), f"in pieces of {size}"
    return events, stats


def packet(count: int = 40, first: int = 100, *, seed: int = 0, marked: bool = True, control: int = 0) -> bytes:
    random = Random(seed)
    distances = [random.randrange(1, 30_000) for _ in range(count)]
    return pack_points(distances, first, (first + 11 * (count - 1)) % FULL_TURN_Q6, control=control, marked=marked)


CLEAN = [packet(first=500 * n, seed=n) for n in range(12)]


@pytest.mark.parametrize("count", [1, 2, 39, 80, 81, 127, 128, 255])
def test_every_length_is_a_packet(count: int) -> None:
    packets = [*CLEAN[:3], packet(count, 2000), *CLEAN[3:]]
    events, stats = in_any_pieces(b"".join(packets))
    assert kept(events) == packets
    assert stats.skipped_bytes == 0


def magic_packet(seed: int) -> bytes:
    """A packet full of what could begin a packet, a header or a record."""
    words = [0x55AA, 0x2800, 0x5AA5, 0x0005, 0x8140, 0x66AA, 0xAA28, 0xAA55, 0x0155, 0x5AA5] * 4
    Random(seed).shuffle(words)
    return pack_points(words, 600 + seed, 1000 + seed)


@pytest.mark.exhaustive("seed", sample=range(6), full=range(20))
def test_magic_bytes_inside_a_damaged_packet_cost_nothing_more(seed: int) -> None:
    bad = bytearray(magic_packet(seed))
    bad[9] ^= 0x10
    for broken in (bytes(bad), bytes(bad[:-1]), bytes(bad[5:])):
        events, stats = in_any_pieces(b"".join([*CLEAN[:5], broken, *CLEAN[5:]]))
        assert kept(events) == CLEAN
        assert stats.skipped_bytes == len(broken)


RECORDS = {
    "time stamp": pack_time_stamp(123_456, 7),
    "time stamp with magic": pack_time_stamp(0x55AA_55AA, 0xAA),
    "scan header": SCAN_HEADER,
    "device information": pack_response(0x04, bytes(range(20))),
}


@pytest.mark.parametrize("name", RECORDS)
def test_records_between_packets_are_no_noise(name: str) -> None:
    record = RECORDS[name]
    raw = b"".join([record, *CLEAN[:5], record, record, *CLEAN[5:9], record, *CLEAN[9:]])
    events, stats = in_any_pieces(raw)
    assert kept(events) == CLEAN
    assert len(events) == 1
    assert (stats.records, stats.skipped_bytes) == (4, 0)


def test_a_damaged_time_stamp_is_noise() -> None:
    bad = bytearray(pack_time_stamp(1000))
    bad[2] ^= 1
    events, stats = in_any_pieces(b"".join([*CLEAN[:5], bytes(bad), *CLEAN[5:]]))
    assert kept(events) == CLEAN
    assert (stats.records, stats.skipped_bytes) == (0, 8)


def test_headings_and_offsets() -> None:
    start = pack_points([700], 22739, 22739, control=start_control(10.0))
    packets = [packet(39, 22290), start, packet(40, 22751), packet(1, 160), packet(2, FULL_TURN_Q6)]
    wire, raw = PointCloud(), b"".join(packets)
    parsed = in_one_run(wire, raw)
    # One sample that begins nothing is the last of its revolution: 2 degrees earlier it passes no seam.
    assert list(wire.headings(parsed)) == [22290, 22739 | BEGINS, 22751, 160 - 128, 0]
    assert list(packet_offsets(parsed.blocks)) == [0, 88, 100, 190, 202, len(raw)]


@pytest.mark.repeats
@given(
    harm=st.sampled_from([damage.flip, damage.drop_bytes, damage.insert_bytes]),
    probability=st.sampled_from([0.0003, 0.003, 0.02]),
    seed=st.integers(0, 2**32),
    cuts=st.lists(st.integers(1, 400), min_size=1, max_size=20),
)
def test_damage_costs_what_it_hits_however_it_is_chopped(
    harm: object, probability: float, seed: int, cuts: list[int]
) -> None:
    assert callable(harm)
    clean = golden.load("ydlidar_4ros_wrap").raw[:9020]
    packets = ydlidar.split(clean)
    harmed = harm(clean, probability, seed)
    # What is undecided at the end is told apart by what follows.
    raw = harmed.raw + b"".join(CLEAN)
    whole = receive(raw)
    assert receive(raw, 1) == whole
    link = Link()
    link.send_request(commands.scan(PointCloud()))
    link.receive_data(SCAN_HEADER, 0)
    at = turn = 0
    while at < len(raw):
        link.receive_data(raw[at : at + cuts[turn % len(cuts)]], 0)
        at, turn = at + cuts[turn % len(cuts)], turn + 1
    assert merged(link.events_received()[1:]) == whole[0]
    hit = damage.hit_packets(harmed, packets)
    if harm is damage.flip:
        # Two flips in the same bit of two words leave the check value right: nobody can tell.
        hit = {number for number in hit if not undetectable(raw, packets, number)}
        packets = slices_of(raw, packets)
    survivors = [packet for number, packet in enumerate(packets) if number not in hit]
    assert kept(whole[0]) == survivors + CLEAN


def slices_of(raw: bytes, packets: list[bytes]) -> list[bytes]:
    """What stands in `raw` where `packets` stood."""
    found, at = [], 0
    for clean in packets:
        found.append(raw[at : at + len(clean)])
        at += len(clean)
    return found


def undetectable(raw: bytes, packets: list[bytes], number: int) -> bool:
    found, clean = slices_of(raw, packets)[number], packets[number]
    same = found[:2] == clean[:2] and found[3] == clean[3]
    return same and ydlidar.checksum(found) == int.from_bytes(found[8:10], "little")


@pytest.mark.parametrize("behind", [0, 1, 11])
def test_the_first_packet_after_noise_is_not_kept_waiting(behind: int) -> None:
    for noise in (b"\x00", CLEAN[0][:50], CLEAN[0][:-1] + b"\xff"):
        events, _ = in_any_pieces(noise + CLEAN[1] + CLEAN[2][:behind])
        assert kept(events) == [CLEAN[1]]


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
    each = KINDS[kind].sample_size
    assert all(
        size == (10 + each * count if count and (bits or count <= 80) else NO_PACKET)
        for (count, bits), size in claimed.items()
    )
