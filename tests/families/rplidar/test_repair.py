"""0x83: a packet with one flipped bit is repaired by its CRC, and no other damage passes for that."""

from random import Random

import pytest

from lidario.families.rplidar.formats import HqFormat
from tests.support.cases import CASES, Case, named

SIZE = 781
HQ = [case for case in CASES if case.response_type == 0x83]
every_case = pytest.mark.parametrize("case", HQ, ids=named)


def taken(packet: bytes, follower: bytes) -> bytes:
    """What is taken of a packet that stands where one is due, and of the one behind it."""
    data = bytearray(packet + follower)
    stretch = HqFormat().run(data, 0)
    return bytes(data[: stretch.middle])


@every_case
def test_every_single_flipped_bit_is_turned_back(case: Case) -> None:
    """All but those of the first byte, by which a packet is known to begin."""
    clean, follower = case.packets[7], case.packets[8]
    for bit in range(8, 8 * SIZE):
        packet = bytearray(clean)
        packet[bit // 8] ^= 1 << bit % 8
        assert taken(bytes(packet), follower) == clean + follower


@every_case
def test_nothing_else_is_taken_for_it(case: Case) -> None:
    """Two to five flipped bits, bursts, shifted bytes: nothing is delivered that was not sent."""
    random, wrong = Random(5), 0
    for trial in range(6000):
        number = random.randrange(len(case.packets) - 1)
        packet = bytearray(case.packets[number])
        if trial % 4 == 0:
            begin = random.randrange(1, SIZE - 40)
            packet[begin : begin + 40] = random.randbytes(40)
        elif trial % 4 == 1:
            at = random.randrange(1, SIZE)
            packet = packet[:at] + packet[at + 1 :] + case.packets[number + 1][:1]
        else:
            for bit in random.sample(range(8, 8 * SIZE), random.randrange(2, 6)):
                packet[bit // 8] ^= 1 << bit % 8
        found = taken(bytes(packet), b"")
        wrong += bool(found) and found != case.packets[number]
    assert wrong == 0
