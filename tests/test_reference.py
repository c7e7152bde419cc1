"""The scalar reference of the 4ROS against the vendor-decoded streams, and what tests damage streams with."""

from functools import cache

import numpy as np
import pytest

from tests.reference import damage, golden, ydlidar
from tests.reference.golden import GRID_Q6, angle_errors


@cache
def ydlidar_stream(name: str) -> tuple[golden.Golden, list[bytes], list[ydlidar.Sample]]:
    stream = golden.load(name)
    packets = ydlidar.split(stream.raw)
    return stream, packets, ydlidar.decode(packets)


# ------------------------------------------------------------------------------------------------------- 4ROS


@pytest.mark.parametrize("name", golden.names_of("ydlidar_4ros"))
def test_ydlidar_samples(name: str) -> None:
    stream, _, samples = ydlidar_stream(name)
    closed = samples[: len(stream.angle_deg)]
    assert closed[-1].packet + 1 == samples[len(closed)].packet
    assert samples[len(closed)].start
    assert not any(sample.start for sample in samples[len(closed) + 1 :])  # what follows is one open turn
    assert [sample.distance_mm for sample in closed] == stream.distance_mm.tolist()
    assert all(sample.quality is None for sample in samples)
    assert all(0 <= sample.angle_deg < 360 for sample in samples)
    errors = angle_errors(stream, [sample.angle_deg for sample in closed])
    assert errors.max() <= 1e-9
    assert errors.min() > -(GRID_Q6 + 1e-4)


@pytest.mark.parametrize("name", golden.names_of("ydlidar_4ros"))
def test_ydlidar_revolutions(name: str) -> None:
    stream, _, samples = ydlidar_stream(name)
    assert stream.scan is not None
    turns = ydlidar.revolutions(samples)
    assert [len(turn) for turn in turns] == np.bincount(stream.scan).tolist()
    assert [sample for turn in turns for sample in turn] == samples[: len(stream.scan)]
    assert all(turn[0].start and not turn[1].start for turn in turns)
    # Joined in the middle of a turn, the rest of that turn is left out.
    assert ydlidar.revolutions(samples[1:]) == turns[1:]


def test_ydlidar_angle_wraps_inside_a_packet() -> None:
    _, _, samples = ydlidar_stream("ydlidar_4ros_wrap")
    past = [sample for sample in samples if sample.raw_deg >= 360]
    assert past
    assert all(sample.angle_deg == sample.raw_deg - 360 for sample in past)


def test_ydlidar_split_refuses_damage() -> None:
    raw = golden.load("ydlidar_4ros_room10").raw[: 12 + 90]
    assert [len(packet) for packet in ydlidar.split(raw)] == [12, 90]
    for offset, match in [(12, "no packet"), (14, "checksum"), (20, "checksum"), (50, "checksum")]:
        spoiled = bytearray(raw)
        spoiled[offset] ^= 0x10
        with pytest.raises(ValueError, match=match):
            ydlidar.split(bytes(spoiled))
    with pytest.raises(ValueError, match="0 samples"):
        ydlidar.split(raw[:15] + bytes([0]) + raw[16:])
    with pytest.raises(ValueError, match="incomplete"):
        ydlidar.split(raw[:-1])
    with pytest.raises(ValueError, match="incomplete header"):
        ydlidar.split(raw[:15])


# ----------------------------------------------------------------------------------------------------- damage


def test_flip() -> None:
    raw = bytes(range(256)) * 40
    spoiled = damage.flip(raw, 0.01, seed=1)
    assert spoiled == damage.flip(raw, 0.01, seed=1)
    assert spoiled != damage.flip(raw, 0.01, seed=2)
    assert 50 < len(spoiled.touched) < 160
    changed = {offset: a ^ b for offset, (a, b) in enumerate(zip(raw, spoiled.raw, strict=True)) if a != b}
    assert tuple(changed) == spoiled.touched
    assert all(bits.bit_count() == 1 for bits in changed.values())


def test_drop_bytes() -> None:
    raw = bytes(range(256))
    spoiled = damage.drop_bytes(raw, 0.1, seed=1)
    assert spoiled == damage.drop_bytes(raw, 0.1, seed=1)
    assert spoiled.touched
    assert spoiled.raw == bytes(value for value in range(256) if value not in spoiled.touched)


def test_insert_bytes() -> None:
    raw = bytes(range(256))
    spoiled = damage.insert_bytes(raw, 0.1, seed=1)
    assert spoiled == damage.insert_bytes(raw, 0.1, seed=1)
    assert spoiled.touched
    restored = bytearray(spoiled.raw)
    for offset in spoiled.touched:
        del restored[offset]
    assert bytes(restored) == raw


def test_drop_packets() -> None:
    packets = [b"aa", b"b", b"cc", b"d"]
    spoiled = damage.drop_packets(packets, [2, 0, 2])
    assert spoiled.raw == b"bd"
    assert spoiled.touched == (0, 2)
    assert damage.drop_packets(packets, []).raw == b"aabccd"
    for wrong in (-1, 4):
        with pytest.raises(IndexError):
            damage.drop_packets(packets, [wrong])


def test_nothing_happens_at_probability_zero_and_everything_at_one() -> None:
    raw = bytes(range(64))
    for spoil in (damage.flip, damage.drop_bytes, damage.insert_bytes):
        assert spoil(raw, 0.0, 1).raw == raw
        assert spoil(raw, 0.0, 1).touched == ()
        assert spoil(raw, 1.0, 1).touched == tuple(range(64))


def test_hit_packets() -> None:
    packets = [b"aa", b"b", b"cccc"]
    assert damage.hit_packets(damage.Damage(b"", (1, 3, 6), "byte"), packets) == {0, 2}
    assert damage.hit_packets(damage.Damage(b"", (0, 1, 2, 3), "gap"), packets) == {0}
    assert damage.hit_packets(damage.Damage(b"", (1, 2), "packet"), packets) == {1, 2}


def test_names() -> None:
    assert sorted(path.stem for path in golden.DATA.glob("*.npz")) == sorted(golden.NAMES)
