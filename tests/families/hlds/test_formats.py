"""What is a packet, with a check value that is known and without."""

import pytest

from lidario.families.hlds import TALKERS
from lidario.families.hlds.formats import SIZE, CheckedFormat, PacketFormat
from lidario.families.hlds.simulated import pack_packet
from lidario.wire.rows import Fold15
from tests.families.hlds.about import CASES
from tests.reference.samples import fold
from tests.support.streams import checked_one_by_one

PACKETS = CASES[0].packets
TWICE = bytes.fromhex("CBCB")
"""Of six samples of 1500 at 1000 to 1005 mm, 300 revolutions a minute: the protocol sheet's example."""


def example(check: bytes | None = None) -> bytes:
    return pack_packet(0, [1000.0 + at for at in range(6)], [1500] * 6, check=check)


def folded(packet: bytes) -> bytes:
    """With the check value of an XV-11."""
    return packet[:40] + fold(packet[:40]).to_bytes(2, "little")


def test_the_examples_of_both_check_values() -> None:
    assert example()[40:] == TWICE
    assert folded(example())[40:] == bytes.fromhex("2124")
    assert Fold15(20).holds(bytearray(folded(example())), 0)


@pytest.mark.parametrize("count", [3, 12])
def test_many_without_a_check_value_are_judged_as_one_is(count: int) -> None:
    packets = list(PACKETS[:count])
    packets[-2] = packets[-2][:1] + b"\xff" + packets[-2][2:]
    whole = b"".join(PACKETS[:count])
    following = PACKETS[count][:2]
    no_mark = whole[:-SIZE] + b"\xfb" + PACKETS[count - 1][1:]
    for raw in (b"".join(packets), whole, whole + b"\xfa", whole + following, no_mark + following):
        data = bytearray(raw)
        assert PacketFormat().run(data, 0) == checked_one_by_one(PacketFormat(), data, 0)


def test_without_a_check_value_the_next_one_must_follow() -> None:
    wire, data = PacketFormat(), bytearray(b"".join(PACKETS[:3]))
    assert wire.run(data, 0).end == 2 * SIZE
    assert wire.run(bytearray(PACKETS[0] + PACKETS[2] + PACKETS[3]), 0).end == 0
    last = pack_packet(59, [0.0] * 6, [0] * 6)
    assert wire.run(bytearray(last + pack_packet(0, [0.0] * 6, [0] * 6)), 0).end == SIZE


@pytest.mark.parametrize("right", [0, 20, 29, 30, 31, 60])
@pytest.mark.parametrize("fold", [False, True])
def test_a_check_value_that_holds_in_most_packets_is_a_rule(right: int, fold: bool) -> None:
    heard = b"".join(
        (folded(each) if fold else each) if at < right else each[:40] + b"\x12\x34"
        for at, each in enumerate(PACKETS[:60])
    )
    model = TALKERS.model_of(None, heard)
    assert (model.wire is CheckedFormat) == (right > 30)
    assert ("damage" in model.note) != (right > 30)
