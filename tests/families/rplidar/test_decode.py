"""Decoding inverts packing, format by format, for whatever a format can carry; and what a gap leaves untold."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from lidario.families.arcs import in_turn
from lidario.families.base import Samples
from lidario.families.rplidar.cabins import ultra_dense_cabins
from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.decode_capsules import DenseDecoder
from lidario.families.rplidar.formats import FORMATS
from lidario.families.rplidar.simulated import packers
from lidario.wire.events import Packets
from tests.reference import rplidar
from tests.support.streams import SINGLE_DEG, arrived, in_one_run

Ints = NDArray[np.int64]
P = 3
"""Packets a trial, and one behind them."""
starts = st.tuples(st.integers(0, 23039), st.integers(200, 3000))


def decode(kind: int, raw: bytes) -> Samples:
    """All packets but the last, which tells where the others end."""
    size = rplidar.PACKET_BYTES[kind]
    return DECODERS[kind]().decode(in_one_run(FORMATS[kind](), raw[:-size]), raw[-size:])


def beginnings(start: tuple[int, int], packets: int = P + 1) -> Ints:
    first, arc = start
    angles: Ints = (first + arc * np.arange(packets)) % 23040
    return angles


def even(start: tuple[int, int], count: int) -> NDArray[np.float64]:
    """Samples at equal steps, on and on."""
    first, arc = start
    degrees: NDArray[np.float64] = (first + arc * np.arange(P * count) / count) / 64
    return degrees


def apart(ours: NDArray[Any], theirs: NDArray[Any]) -> NDArray[np.float64]:
    """Degrees from one to the other, the short way round."""
    degrees: NDArray[np.float64] = (ours.astype(np.float64) - theirs + 180) % 360 - 180
    return degrees


def check_counts(samples: Samples, count: int) -> None:
    """That nothing is missing, and that the samples are counted packet by packet."""
    assert (samples.lost, samples.lost_behind, samples.unbroken) == (0, 0, P)
    assert list(samples.ends) == [count * (n + 1) for n in range(P)]


@given(start=starts, mm=hnp.arrays(np.int64, (P + 1, 40), elements=st.integers(0, 65535)))
def test_dense(start: tuple[int, int], mm: Ints) -> None:
    samples = decode(0x85, packers.pack_dense(beginnings(start), mm))
    np.testing.assert_array_equal(samples.distance_mm, mm[:-1].ravel())
    assert samples.intensity is None
    check_counts(samples, 40)
    assert np.abs(apart(samples.angle_deg, even(start, 40))).max() <= SINGLE_DEG


@given(
    start=starts,
    mm=hnp.arrays(np.int64, (P + 1, 32), elements=st.integers(0, 16383)),
    offsets=hnp.arrays(np.int64, (P + 1, 32), elements=st.integers(0, 63)),
)
def test_express(start: tuple[int, int], mm: Ints, offsets: Ints) -> None:
    samples = decode(0x82, packers.pack_express(beginnings(start), mm, offsets))
    np.testing.assert_array_equal(samples.distance_mm, mm[:-1].ravel())
    check_counts(samples, 32)
    behind = apart(even(start, 32), samples.angle_deg) * 8
    np.testing.assert_allclose(behind, offsets[:-1].ravel(), atol=8 * SINGLE_DEG)


@given(start=starts, mm=hnp.arrays(np.int64, (P + 1, 96), elements=st.integers(0, 30000)), seed=st.integers(0, 99))
def test_ultra(start: tuple[int, int], mm: Ints, seed: int) -> None:
    smooth = np.random.default_rng(seed).integers(-30, 30, mm.shape).cumsum(axis=None).reshape(mm.shape) + 3000
    for scene in (mm, np.clip(smooth, 0, 28000)):
        packets = [
            packers.pack_ultra(start, row, following[0])
            for start, row, following in zip(beginnings(start), scene, [*scene[1:], scene[0]], strict=True)
        ]
        raw = b"".join(packets)
        reference, samples = rplidar.decode(0x84, rplidar.split(0x84, raw)), decode(0x84, raw)
        assert samples.distance_mm.tolist() == [s.distance_mm for s in reference]
        check_counts(samples, 96)


@given(
    start=starts,
    mm=hnp.arrays(np.int64, (P + 1, 64), elements=st.integers(2060, 65522)),
    quality=hnp.arrays(np.int64, (P + 1, 64), elements=st.integers(0, 255)),
)
def test_ultra_dense(start: tuple[int, int], mm: Ints, quality: Ints) -> None:
    """Beyond the distances that the host smooths."""
    raw = packers.pack_ultra_dense(beginnings(start), mm, quality, time_us=2**32 - 1, status=7)
    reference, samples = rplidar.decode(0x86, rplidar.split(0x86, raw)), decode(0x86, raw)
    assert samples.distance_mm.tolist() == [s.distance_mm for s in reference]
    assert samples.intensity is not None
    assert samples.intensity.tolist() == [s.quality for s in reference]
    assert samples.intensity.dtype == np.uint8
    check_counts(samples, 64)
    assert np.abs(apart(samples.angle_deg, even(start, 64))).max() <= SINGLE_DEG


@given(
    walk=hnp.arrays(np.int64, (P + 1, 64), elements=st.integers(-3, 3)),
    gone=hnp.arrays(np.bool_, (P + 1, 64), elements=st.booleans()),
    base=st.integers(100, 1800),
)
def test_ultra_dense_smooths_short_distances_as_the_reference_does(walk: Ints, gone: Ints, base: int) -> None:
    mm = np.clip(base + walk.cumsum(axis=None).reshape(walk.shape), 0, 2046)
    mm[gone & (walk == 3)] = 0
    raw = packers.pack_ultra_dense(beginnings((100, 900)), mm, 20)
    reference = rplidar.decode(0x86, rplidar.split(0x86, raw))
    assert decode(0x86, raw).distance_mm.tolist() == [s.distance_mm for s in reference]
    # In turns of one packet, too: the last distance is carried on.
    decoder, found, packets = DECODERS[0x86](), list[float](), rplidar.split(0x86, raw)
    for packet, following in pairwise(packets):
        found += decoder.decode(arrived(packet, 1, 0), following).distance_mm.tolist()
    assert found == [s.distance_mm for s in reference]


def test_a_long_chain_of_smoothing_ends() -> None:
    """Each sample hangs on the one before: the worst case for solving them all at once."""
    low = [501 << 2] + [500 << 2] * (200 * 64 - 1)
    pairs = zip(low[::2], low[1::2], strict=True)
    cabins = b"".join(one.to_bytes(2, "little") + other.to_bytes(2, "little") + b"\0" for one, other in pairs)
    distance, _ = ultra_dense_cabins(np.frombuffer(cabins, np.uint16).reshape(200, 80), 4008)
    expected, last = [], 4008
    for word in low:
        last = ((word >> 2) * 8 + last) >> 1 if abs((word >> 2) * 8 - last) <= 8 else (word >> 2) * 8
        expected.append(last)
    assert distance.tolist() == expected


@given(
    angle=hnp.arrays(np.int64, (P, 96), elements=st.integers(0, 65535)),
    distance=hnp.arrays(np.int64, (P, 96), elements=st.integers(0, 2**24 - 1)),
    quality=hnp.arrays(np.int64, (P, 96), elements=st.integers(0, 255)),
)
def test_hq(angle: Ints, distance: Ints, quality: Ints) -> None:
    raw = packers.pack_hq(angle, distance, quality, quality & 1, time_us=2**63)
    samples = DECODERS[0x83]().decode(in_one_run(FORMATS[0x83](), raw), None)
    np.testing.assert_array_equal(samples.distance_mm, distance.ravel() / 4)
    np.testing.assert_array_equal(samples.angle_deg, (angle.ravel() * 90 / 16384).astype(np.float32))
    assert samples.intensity is not None
    np.testing.assert_array_equal(samples.intensity, quality.ravel())


@pytest.mark.parametrize("first", [0, 20_000, 60_000, 65_500])
def test_the_seam_may_lie_anywhere_in_a_packet_of_whole_nodes(first: int) -> None:
    angle = (first + 100 * np.arange(96)) % 65536
    packet = in_one_run(FORMATS[0x83](), packers.pack_hq(angle, [4000] * 96, [40] * 96, [0] * 96))
    for before in range(97):
        samples = DECODERS[0x83]().decode(packet, None, seam=(first + 100 * before - 50) % 65536)
        # One that the rotor passed just before the packet, it passes again a revolution later.
        assert samples.before_seam == (before or 96)


@given(
    angle=hnp.arrays(np.int64, 50, elements=st.integers(0, 23039)),
    distance=hnp.arrays(np.int64, 50, elements=st.integers(0, 65535)),
    quality=hnp.arrays(np.int64, 50, elements=st.integers(0, 63)),
    start=hnp.arrays(np.bool_, 50),
)
def test_standard(angle: Ints, distance: Ints, quality: Ints, start: NDArray[np.bool_]) -> None:
    samples = DECODERS[0x81]().decode(
        in_one_run(FORMATS[0x81](), packers.pack_standard(angle, distance, quality, start)), None
    )
    np.testing.assert_array_equal(samples.distance_mm, distance / 4)
    np.testing.assert_array_equal(samples.angle_deg, angle / 64)
    assert samples.intensity is not None
    np.testing.assert_array_equal(samples.intensity, quality << 2)


# ----------------------------------------------------------------------------------------------------- gaps


@pytest.mark.parametrize("behind_gap", [0, 2564])
@pytest.mark.parametrize("major", [0, 2560])
def test_what_leans_on_a_lost_packet_has_no_distance(major: int, behind_gap: int) -> None:
    """0x84's last two predictions may rest on the packet that follows: another one will not do."""
    mm = np.full((1, 96), 2560)
    mm[0, 93] = major
    lead = [packers.pack_ultra(700 * n, np.full(96, 2560), 2560) for n in range(8)]
    before = packers.pack_ultra(5600, mm, 2560)
    after = np.full(96, 2560)
    after[0] = behind_gap
    behind = packers.pack_ultra(5600 + 1400, after, 2560)
    for packets, following in (([*lead, before, behind], None), ([*lead, before], behind), ([*lead, before], None)):
        samples = DECODERS[0x84]().decode(arrived(b"".join(packets), len(packets), 0), following)
        ours = samples.distance_mm[8 * 96 : 9 * 96].tolist()
        # A major of 0 leaves its left neighbour, which leans on it, without a distance as well.
        assert ours[:92] == [2560] * 92
        assert ours[93:] == ([2560, 2560, 0] if major else [0, 0, 0])


def test_angles_are_brought_into_the_turn() -> None:
    degrees = np.array([-1e-16, -0.5, 0.0, 359.75, 360.0, 400.0], np.float32)
    in_turn(degrees, 360, back=True)
    assert degrees.tolist() == [0.0, 359.5, 0.0, 359.75, 0.0, 40.0]


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("samples", [32, 40, 64, 96])
def test_an_angle_beside_360_degrees_stays_on_its_side(samples: int, back: bool) -> None:
    """The division may round. The critical number is the greatest one below 360 degrees."""
    turn = np.float32(23040 * samples)
    edges = [
        turn,
        np.nextafter(turn, np.float32(0)),
        np.nextafter(turn, np.float32(np.inf)),
        turn * np.float32(1.5),
    ]
    below = [-np.float32(1e-3), -np.float32(0.25), -turn / 2] if back else []
    within = np.random.default_rng(0).uniform(-float(turn) if back else 0, 2 * float(turn), 5000)
    angles = np.array([0.0, *edges, *below, *within], np.float32)
    expected = []
    for angle in angles:
        ahead = angle + turn if angle < 0 else angle
        expected.append(ahead - turn if ahead >= turn else ahead)
    in_turn(angles, int(turn), back=back)
    assert angles.tolist() == expected
    assert angles.min() >= 0
    assert angles.max() < turn


# ------------------------------------------------------------------------------------------ several revolutions


def _dense(counts: list[int]) -> list[bytes]:
    """Revolutions of so many packets each, and one packet more; the steps of each revolution are equal."""
    starts = np.concatenate([np.arange(count) * 23040 // count for count in [*counts, 80]])[: sum(counts) + 1]
    raw = packers.pack_dense(starts, np.arange(len(starts) * 40).reshape(-1, 40))
    return [raw[at : at + 84] for at in range(0, len(raw), 84)]


def _run(packets: list[bytes]) -> Packets:
    return in_one_run(FORMATS[0x85](), b"".join(packets))


def _remembered(decoder: DenseDecoder) -> list[float]:
    """What a packet before a gap is decoded to: its arc is that of the packet before."""
    alone = packers.pack_dense([0], [[1] * 40])
    following = packers.pack_dense([23040 // 80 * 20], [[1] * 40])
    return [float(angle) for angle in decoder.fork().decode(_run([alone]), following).angle_deg]


def test_steady_revolutions_are_remembered_only_when_settled() -> None:
    packets = _dense([80, 72, 90])
    one_by_one, together = DenseDecoder(), DenseDecoder()
    for decoder in (one_by_one, together):
        decoder.decode(_run(packets[:80]), packets[80])
    before = _remembered(together)
    samples = together.decode_steady(_run(packets[80:242]), packets[242], [72, 162], seam=0)
    assert samples is not None
    assert _remembered(together) == before
    samples.settle()
    first = one_by_one.decode(_run(packets[80:152]), packets[152], seam=0)
    second = one_by_one.decode(_run(packets[152:242]), packets[242], seam=0)
    np.testing.assert_array_equal(samples.angle_deg, np.concatenate((first.angle_deg, second.angle_deg)))
    assert list(samples.before_seam) == [first.before_seam, 72 * 40 + second.before_seam]
    assert list(samples.revolution_packets) == [first.revolution_packets, second.revolution_packets]
    assert first.revolution_packets != second.revolution_packets
    assert _remembered(together) == _remembered(one_by_one) != before


def test_revolutions_with_a_gap_are_not_steady() -> None:
    packets = _dense([80, 80, 80])
    decoder = DenseDecoder()
    decoder.decode(_run(packets[:80]), packets[80])
    gap = packets[80:190] + packets[191:240]
    assert decoder.decode_steady(_run(gap), packets[240], [80, 159]) is None
    assert decoder.decode_steady(_run(packets[80:240]), packets[5], [80, 160]) is None
    assert decoder.decode_steady(_run(packets[80:240]), packets[240], [80, 160]) is not None
