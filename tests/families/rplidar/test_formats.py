"""Where packets begin, how long they are, and which are believed, format by format."""

import numpy as np
import pytest

from lidario.families.rplidar.formats import FORMATS
from lidario.families.rplidar.simulated import packers
from tests.support.streams import arrived

CAPSULES = (0x82, 0x84, 0x85, 0x86)
capsules = pytest.mark.parametrize("kind", CAPSULES)


@capsules
def test_any_nibbles_may_stand_beside_the_marks(kind: int) -> None:
    stream = FORMATS[kind]()
    found = {
        (first, second)
        for first in range(256)
        for second in range(256)
        if stream.measure(bytearray((first, second)), 0) == stream.shortest
    }
    assert found == {(0xA0 | low, 0x50 | high) for low in range(16) for high in range(16)}


def test_a_start_angle_beyond_the_turn_is_brought_into_it() -> None:
    raw = packers.pack_dense([0, 23039, 23040, 23041, 0x7FFF], np.zeros((5, 40)))
    assert list(FORMATS[0x85]().headings(arrived(raw, 5, 0))) == [0, 23039, 0, 1, 0x7FFF - 23040]
