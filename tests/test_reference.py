"""The scalar references, and what tests damage streams with.

`tests.test_golden` compares the samples of the references: with what lidario decodes, which is compared with the
vendors'. `tests.test_reference_rplidar` has what is beyond the golden streams.
"""

import numpy as np
import pytest

from tests.reference import damage, golden, ydlidar
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


# ----------------------------------------------------------------------------------------------------- damage


def test_damage_is_where_it_says_and_nowhere_else() -> None:
    raw = bytes(range(256)) * 4
    flipped, dropped, inserted = (
        spoil(raw, 0.1, 1) for spoil in (damage.flip, damage.drop_bytes, damage.insert_bytes)
    )
    changed = {at: a ^ b for at, (a, b) in enumerate(zip(raw, flipped.raw, strict=True)) if a != b}
    assert tuple(changed) == flipped.touched
    assert {bits.bit_count() for bits in changed.values()} == {1}
    assert dropped.raw == bytes(byte for at, byte in enumerate(raw) if at not in dropped.touched)
    restored = bytearray(inserted.raw)
    for at in inserted.touched:
        del restored[at]
    assert bytes(restored) == raw
    assert all(60 < len(each.touched) < 150 for each in (flipped, dropped, inserted))


def test_hit_packets() -> None:
    packets = [b"aa", b"b", b"cccc"]
    assert damage.hit_packets(damage.Damage(b"", (1, 3, 6), "byte"), packets) == {0, 2}
    assert damage.hit_packets(damage.Damage(b"", (0, 1, 2, 3), "gap"), packets) == {0}


def test_names() -> None:
    assert sorted(path.stem for path in golden.DATA.glob("*.npz")) == sorted(golden.NAMES)
