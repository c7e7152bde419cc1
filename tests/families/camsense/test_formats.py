"""What is a packet, what is none, and what only tells that the rotor speeds up."""

from lidario.families.camsense.formats import LongFormat
from lidario.families.camsense.simulated import pack_packet
from tests.families.camsense.about import CASES
from tests.support.streams import checked_one_by_one, feed

PACKETS = CASES[0].packets
LONG = [pack_packet(0xA000 + 700 * at, 0xA000 + 700 * at + 640, [1000.0 + at] * 12, [80] * 12) for at in range(30)]


def test_each_damaged_bit_of_a_longer_one_is_found() -> None:
    """What is carried twice is lost: behind the mark, the last fourteen words are checked, and the check value."""
    (packet, *_), wire = LONG, LongFormat()
    assert wire.run(bytearray(packet), 0).packets
    for bit in (*range(32), *range(8 * (len(packet) - 30), 8 * len(packet))):
        damaged = bytearray(packet)
        damaged[bit // 8] ^= 1 << bit % 8
        assert not wire.run(damaged, 0).packets, bit


def test_many_longer_ones_are_judged_as_one_is() -> None:
    raw = bytearray(b"".join(LONG[:12]))
    raw[7 * LongFormat().shortest + 20] ^= 1
    assert LongFormat().run(raw, 0).end == 7 * LongFormat().shortest
    assert LongFormat().run(raw, 0) == checked_one_by_one(LongFormat(), raw, 0)


def test_what_no_rotor_can_turn_in_a_packet_is_damage() -> None:
    odd = [pack_packet(0xA000 + 900, 0xA000 + at, [1000.0] * 8, [80] * 8) for at in (850, 900 + 46 * 64, 361 * 64)]
    stats = feed(CASES[0], b"".join([*PACKETS[:10], *odd, *PACKETS[10:20]])).stats
    assert (stats.packets, stats.records, stats.skipped_bytes) == (20, 0, 3 * 36)
