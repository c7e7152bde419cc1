"""Smoothing, the edges of angles, and what a gap leaves untold.

`tests/properties/test_decoding.py` compares all formats with their scalar references.
"""

from collections.abc import Sequence
from itertools import pairwise

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
from lidario.families.rplidar.formats import FORMATS
from lidario.families.rplidar.simulated import packers
from tests.families.rplidar.about import CASES
from tests.families.rplidar.test_nodes import triangulated
from tests.reference import rplidar
from tests.support.streams import arrived, in_one_run

Ints = NDArray[np.int64]
P = 3
"""Packets a trial, and one behind them."""


def decode(kind: int, raw: bytes) -> Samples:
    """All packets but the last, which tells where the others end."""
    size = rplidar.PACKET_BYTES[kind]
    return DECODERS[kind]().decode(in_one_run(FORMATS[kind](), raw[:-size]), raw[-size:])


def beginnings(start: tuple[int, int], packets: int = P + 1) -> Ints:
    first, arc = start
    angles: Ints = (first + arc * np.arange(packets)) % 23040
    return angles


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


@pytest.mark.parametrize("first", [0, 20_000, 60_000, 65_500])
def test_the_seam_may_lie_anywhere_in_a_packet_of_whole_nodes(first: int) -> None:
    angle = (first + 100 * np.arange(96)) % 65536
    packet = in_one_run(FORMATS[0x83](), packers.pack_hq(angle, [4000] * 96, [40] * 96, [0] * 96))
    for before in range(97):
        samples = DECODERS[0x83]().decode(packet, None, seam=(first + 100 * before - 50) % 65536)
        # One that the rotor passed just before the packet, it passes again a revolution later.
        assert samples.last.before_seam == (before or 96)


# ----------------------------------------------------------------------------------------------------- gaps


@pytest.mark.parametrize("untold", [(), range(2, 288, 4), range(96)], ids=["none", "each fourth", "first"])
@pytest.mark.parametrize("mm", [300, 900])
def test_a_lost_node_is_missed_where_it_was_though_a_near_target_lies_beside_its_beam(
    mm: int, untold: Sequence[int]
) -> None:
    """0x81: where that begins, angles leap by as much as there. Of those that are untold, none shows its beam."""
    beams, far = [1.25 * at for at in range(288)], [4000] * 288
    near = [*far[:200], *[mm] * 40, *far[240:]]
    near = [-3000 if at in untold else each for at, each in enumerate(near)]
    full, raw = triangulated(beams, far), triangulated(beams, near)
    decoder = DECODERS[0x81]()
    decoder.decode(arrived(full, 288, 0), full[:5])
    assert decoder.decode(arrived(raw[:500] + raw[505:], 287, 0), full[:5]).gaps == [(100, 1)]


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


@pytest.mark.parametrize("split", [False, True])
def test_nothing_is_smoothed_across_a_gap(split: bool) -> None:
    """0x86: distances are halved against the sample before; behind a gap another sample is the one before."""
    mm = np.full((40, 64), 400)
    mm[21:] = 402
    raw = packers.pack_ultra_dense(np.arange(40) * 500, mm, 30)
    packets = [raw[at : at + 170] for at in range(0, len(raw), 170)]
    left = [*packets[:20], *packets[21:]]
    wire, decoder = FORMATS[0x86](), DECODERS[0x86]()
    if split:
        # The gap is between two stretches that are decoded one after the other.
        decoder.decode(in_one_run(wire, b"".join(left[:20])), left[20])
        behind = decoder.decode(in_one_run(wire, b"".join(left[20:])), None).distance_mm[:64]
    else:
        behind = decoder.decode(in_one_run(wire, b"".join(left)), None).distance_mm[20 * 64 : 21 * 64]
    assert set(behind.tolist()) == {402.0}
    # Where nothing is missing, the step is halved, as the vendor does.
    whole = DECODERS[0x86]().decode(in_one_run(wire, raw), None).distance_mm[21 * 64 : 22 * 64]
    assert whole[0] == 401.0


@pytest.mark.parametrize("kind", DECODERS)
def test_one_packet_alone_tells_no_speed(kind: int) -> None:
    case = next(case for case in CASES if case.response_type == kind)
    run = in_one_run(case.make_format(), case.packets[0])
    samples = case.make_decoder().decode(run, None)
    # But for 0x83, whose packets tell the angle of each sample.
    assert samples.certain == (kind == 0x83)
    assert samples.certain or (samples.last.samples, samples.last.packets) == (0, 0)


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
