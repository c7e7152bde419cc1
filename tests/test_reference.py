"""The scalar references, and what tests damage streams with.

`tests.test_golden` compares the samples of the references: with what lidario decodes, which is compared with the
vendors'. `tests.test_reference_rplidar` has what is beyond the golden streams.
"""

import numpy as np
import pytest

from tests.reference import golden, ydlidar
from tests.support.cases import KINDS, Case, named


@pytest.mark.parametrize("case", KINDS, ids=named)
def test_a_reference_refuses_a_damaged_packet(case: Case) -> None:
    """So what it splits is intact: other tests rely on that."""
    raw = bytearray(b"".join(case.packets[:3]))
    first, second = map(len, case.packets[:2])
    # A plain node has nothing but its two check bits.
    raw[first + (second // 2 if second > 5 else 0)] ^= 0x11
    with pytest.raises(ValueError, match=r"packet|byte|stream"):
        case.split(bytes(raw))


@pytest.mark.parametrize("name", golden.names_of("ydlidar_4ros"))
def test_ydlidar_revolutions(name: str) -> None:
    stream = golden.load(name)
    assert stream.scan is not None
    samples = ydlidar.decode(ydlidar.split(stream.raw))
    turns = ydlidar.revolutions(samples)
    assert [len(turn) for turn in turns] == np.bincount(stream.scan).tolist()
    assert [sample for turn in turns for sample in turn] == samples[: len(stream.scan)]
    assert all(turn[0].start and not turn[1].start for turn in turns)
    # Joined in the middle of a turn, the rest of that turn is left out.
    assert ydlidar.revolutions(samples[1:]) == turns[1:]
