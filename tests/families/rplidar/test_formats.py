"""Which headings are told, and which packets are believed.

0x83: a packet with one flipped bit is repaired by its CRC, and no other damage passes for that.
"""

from random import Random

import numpy as np
import pytest

from lidario.families.rplidar.formats import FORMATS, HqFormat
from lidario.families.rplidar.simulated import packers
from tests.support.cases import CASES, Case, named
from tests.support.streams import arrived


def test_a_start_angle_beyond_the_turn_is_brought_into_it() -> None:
    raw = packers.pack_dense([0, 23039, 23040, 23041, 0x7FFF], np.zeros((5, 40)))
    assert list(FORMATS[0x85]().headings(arrived(raw, 5, 0))) == [0, 23039, 0, 1, 0x7FFF - 23040]


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
