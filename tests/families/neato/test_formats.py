"""What is a packet, and what is none."""

from __future__ import annotations

import numpy as np

from lidario.families.neato.formats import BackFormat, PacketFormat
from tests.families.neato.about import CASES
from tests.reference import neato
from tests.support.streams import checked_one_by_one

SIZE = 22


def test_each_damaged_bit_is_found() -> None:
    packet = CASES[0].packets[3]
    wire = PacketFormat()
    assert wire.intact(bytearray(packet), 0, SIZE)
    for bit in range(16, 8 * SIZE):
        damaged = bytearray(packet)
        damaged[bit // 8] ^= 1 << bit % 8
        assert not wire.intact(damaged, 0, SIZE), bit
        assert not neato.is_packet(bytes(damaged))


def test_many_are_judged_as_one_is() -> None:
    packets = list(CASES[0].packets[:12])
    packets[7] = packets[7][:20] + bytes((packets[7][20] ^ 1,)) + packets[7][21:]
    raw = bytearray(b"".join(packets))
    assert PacketFormat().run(raw, 0).end == 7 * SIZE
    assert BackFormat().run(raw, 0) == checked_one_by_one(BackFormat(), raw, 0)


def test_a_frame_with_another_check_value_is_none() -> None:
    """As an Ecovacs LDS-006 sends it: the same fields, and a plain sum."""
    packet = CASES[0].packets[3]
    other = packet[:20] + (sum(packet[:20]) & 0xFFFF).to_bytes(2, "little")
    assert not PacketFormat().intact(bytearray(other), 0, SIZE)
    assert len(np.frombuffer(other, np.uint8)) == SIZE
