"""What is a packet, and what is none."""

from lidario.families.neato.formats import PacketFormat
from tests.families.neato.about import CASES

SIZE = 22


def test_a_frame_with_another_check_value_is_none() -> None:
    """As an Ecovacs LDS-006 sends it: the same fields, and a plain sum."""
    packet = CASES[0].packets[3]
    other = packet[:20] + (sum(packet[:20]) & 0xFFFF).to_bytes(2, "little")
    assert not PacketFormat().intact(bytearray(other), 0, SIZE)
