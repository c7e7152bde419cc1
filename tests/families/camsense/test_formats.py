"""What is a packet, what is none, and what only tells that the rotor speeds up."""

from __future__ import annotations

import pytest

from lidario.families.camsense.formats import LongFormat, PacketFormat
from lidario.families.camsense.simulated.packers import pack_packet
from lidario.families.unasked import begin
from lidario.wire.link import Link
from tests.families.camsense.about import CASES
from tests.reference import camsense
from tests.support.streams import checked_one_by_one

PACKETS = CASES[0].packets
REAL = bytes.fromhex("55AA0308EC4D2FC67A06357A06307B06357A0633790634780622080709ED0609BAC7DB39")
"""A packet of a real X1 (thijses/camsense-X1)."""
LONG = [pack_packet(0xA000 + 700 * at, 0xA000 + 700 * at + 640, [1000.0 + at] * 12, [80] * 12) for at in range(30)]


def test_the_packet_of_a_real_one() -> None:
    wire = PacketFormat()
    assert wire.run(bytearray(REAL), 0).end == len(REAL) == 36
    first, *_, last = camsense.decode([REAL])
    assert (first.raw_deg, last.raw_deg) == (152.734375, 158.90625)


@pytest.mark.parametrize(("wire", "packet"), [(PacketFormat, PACKETS[3]), (LongFormat, LONG[0])])
def test_each_damaged_bit_is_found(wire: type[PacketFormat], packet: bytes) -> None:
    made = wire()
    assert made.run(bytearray(packet), 0).packets
    # What is carried twice is lost: behind the mark, the last fourteen words are checked, and the check value.
    for bit in (*range(32), *range(8 * (len(packet) - 30), 8 * len(packet))):
        damaged = bytearray(packet)
        damaged[bit // 8] ^= 1 << bit % 8
        assert not made.run(damaged, 0).packets, bit


@pytest.mark.parametrize(("wire", "packets"), [(PacketFormat, list(PACKETS[:12])), (LongFormat, LONG[:12])])
def test_many_are_judged_as_one_is(wire: type[PacketFormat], packets: list[bytes]) -> None:
    damaged = packets[7][:20] + bytes((packets[7][20] ^ 1,)) + packets[7][21:]
    raw = bytearray(b"".join([*packets[:7], damaged, *packets[8:]]))
    assert wire().run(raw, 0).end == 7 * wire().shortest
    assert wire().run(raw, 0) == checked_one_by_one(wire(), raw, 0)


def test_packets_without_angles_are_records() -> None:
    none = [0.0] * 8, [0] * 8
    idle = [pack_packet(at, at, *none) for at in (0, 0xA000, 0xB000)]
    raw = b"".join([*idle, *PACKETS[:10], idle[1], *PACKETS[10:20]])
    link = Link()
    link.send_request(begin(PacketFormat()))
    link.receive_data(raw, 0)
    list(link.events_received())
    assert (link.stats.packets, link.stats.records, link.stats.skipped_bytes) == (20, 4, 0)
