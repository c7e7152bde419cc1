"""Which five bytes are a node, alone and in company."""

from collections.abc import Sequence
from copy import deepcopy

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lidario.families.rplidar.nodes import NodeFormat
from lidario.families.rplidar.simulated.packers import pack_standard
from lidario.recording.offline import OfflineDecoder
from lidario.wire.blocks import Block
from lidario.wire.formats import BEGINS
from tests.reference.rplidar import correction_deg
from tests.support.streams import arrived

TURN = 23040


def node(angle_q6: int, *, start: bool = False, distance: int = 4000, quality: int = 40) -> bytes:
    return pack_standard(angle_q6, distance, quality, start)


def in_step(*angles: int) -> NodeFormat:
    """A format that has just followed a quiet rotor up to `angles`."""
    stream = NodeFormat()
    lead = b"".join(node((angles[0] - 7 * k) % TURN) for k in range(30, 0, -1))
    data = bytearray(lead + b"".join(map(node, angles)))
    assert stream.next_stretch(data, 0) == ((Block(5, len(data) // 5),), len(data), len(data))
    return stream


@pytest.mark.parametrize(
    ("angle", "start", "believed"),
    [
        (0, True, True), (29 * 64, True, True), (31 * 64, True, True), (180 * 64, True, True),
        (331 * 64, True, True), (TURN - 1, False, True), (TURN, False, False), (0x7FFF, False, False),
        (180 * 64, False, True),
    ],
)  # fmt: skip
def test_what_one_node_may_say(angle: int, start: bool, believed: bool) -> None:
    data = bytearray(node(angle, start=start))
    assert NodeFormat().intact(data, 0, 5) is believed


@pytest.mark.parametrize(
    ("behind", "follows"),
    [
        *((step, True) for step in (0, 1, 500, 8 * 64, -100, -3 * 64)),
        *((step, False) for step in (8 * 64 + 1, -3 * 64 - 1, TURN // 2)),
    ],
)
def test_a_node_in_step_continues_the_one_before(behind: int, follows: bool) -> None:
    """A little backwards too: what is near scatters by so much."""
    for base in (5000, 100, TURN - 50):
        data = bytearray(node((base + behind) % TURN))
        assert in_step(base).run(data, 0).packets == ((Block(5, 1),) if follows else ()), base


def triangulated(beams: Sequence[float], distances: Sequence[int]) -> bytes:
    """Nodes as an A1 sends them: returns lie beside the beam, by their distance in mm; 0 is none, at the beam.

    Where it is negative, the node has a quality and no distance, though its angle is corrected by that.
    """
    nodes, turns = b"", [int(beam // 360) for beam in beams]
    for beam, mm, turn, before in zip(beams, distances, turns, [turns[0], *turns], strict=False):
        angle = beam - correction_deg(4 * abs(mm)) if mm else beam
        told = 4 * max(mm, 0)
        nodes += node(int(angle * 64) % TURN, start=turn > before, distance=told, quality=15 if mm else 0)
    return nodes


def test_behind_a_sample_without_a_distance_nothing_is_told_of_what_is_elsewhere() -> None:
    for beyond in (22.0, -17.0):
        data = bytearray(triangulated([100.0, 101.0, 102.0, 102.0 + beyond], [4000, 4000, -900, 4000]))
        assert NodeFormat().run(data, 0).packets == (Block(5, 3),)


@pytest.mark.long
@pytest.mark.parametrize("poles", [0, 9])
@pytest.mark.parametrize(
    ("missing", "untold"), [(0.0, 0.0), (0.02, 0.0), (0.1, 0.0), (0.5, 0.0), (0.0, 0.25), (0.6, 0.25), (0.0, 0.5)]
)
def test_of_a_model_that_triangulates_no_node_is_taken_for_damage(
    missing: float, untold: float, poles: int
) -> None:
    """Of 4 m x 6 m, with poles at 0.16 m, each so many degrees wide, and samples without a return.

    Some have a quality and no distance, and their angles are corrected by anything. An A1M8 in an open room sent
    61 to 84 % without a distance, and a quarter of all was of that kind (cpane/heron, rplidar-a1m8-findings).
    """
    random, step = np.random.default_rng(1), 1.27
    beams = [40 + step * at for at in range(round(10.5 * 360 / step))]
    walls = [1000 * min(3 / max(abs(np.cos(b)), 1e-9), 2 / max(abs(np.sin(b)), 1e-9)) for b in np.radians(beams)]
    mm = [160 if beam % 40 < poles else int(wall) for beam, wall in zip(beams, walls, strict=True)]
    for at, kind in enumerate(random.random(len(mm))):
        anything = -int(120 * 100 ** random.random())
        mm[at] = 0 if kind < missing else anything if kind < missing + untold else mm[at]
    nodes = triangulated(beams, mm)
    decoder = OfflineDecoder(b"\xa5\x5a\x05\x00\x00\x40\x81" + nodes)
    scans = list(decoder)
    assert decoder.pipeline.link.stats.skipped_bytes == 0
    assert decoder.pipeline.stats.lost_packets == 0
    assert len(scans) == 9
    assert all(len(scan) == pytest.approx(360 / step, abs=12 / step) for scan in scans)
    samples_a_turn = [60e9 / (scan.rpm * scan.time_increment_ns) for scan in scans]
    assert samples_a_turn == pytest.approx([360 / step] * 9, rel=0.002)
    # What is missing is counted all the same.
    gone = {at + k for at in range(400, 2400, 170) for k in range(1 + at % 3)}
    left = b"".join(nodes[5 * at : 5 * at + 5] for at in range(len(beams)) if at not in gone)
    decoder = OfflineDecoder(b"\xa5\x5a\x05\x00\x00\x40\x81" + left)
    assert len(list(decoder)) == 9
    assert decoder.pipeline.stats.lost_packets == len(gone)


def test_out_of_step_sixteen_in_a_row_are_needed() -> None:
    angles = range(1000, 1000 + 12 * 40, 12)
    data = bytearray(b"".join(map(node, angles)))
    stream = NodeFormat()
    assert stream.next_stretch(data[:95], 0) == ((), 0, 0)
    assert stream.next_stretch(data, 0).packets == (Block(5, 40),)
    broken = data[:75] + bytearray(25) + data[100:]
    stretch = NodeFormat().next_stretch(broken, 0)
    assert (stretch.packets, stretch.middle) == ((), 0)
    assert stretch.end > 0


steps = st.lists(st.one_of(st.integers(0, 60), st.integers(-300, 700)), min_size=20, max_size=80)


@example([0, 0, 0, 0, 0, -1, *[0] * 20], 0, 5)  # back across 0
@given(steps, st.integers(0, TURN - 1), st.integers(0, 2**32))
def test_checking_as_an_array_finds_what_checking_one_by_one_finds(steps: list[int], first: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    angles = (first + np.cumsum(steps)) % TURN
    raw = bytearray(
        pack_standard(
            angles,
            random.integers(0, 65536, len(angles)),
            random.integers(0, 64, len(angles)),
            random.random(len(angles)) < 0.03,
        )
    )
    for _ in range(random.integers(0, 3)):
        raw[random.integers(len(raw))] ^= 1 << int(random.integers(8))
    whole, single = in_step(first), in_step(first)
    at = count = 0
    # Fewer than 16 at a time are never looked at as an array.
    while count < len(angles):
        if not single.run(raw[: at + 5], at).packets:
            break
        at, count = at + 5, count + 1
    assert whole.run(raw, 0).packets == ((Block(5, count),) if count else ())
    assert vars(whole) == vars(single)


@pytest.mark.parametrize("cut", range(5))
def test_an_even_wall_whose_distances_could_be_angles_is_not_taken_for_the_rotor(cut: int) -> None:
    """From its fourth byte on, each of these nodes could be the beginning of one that stands."""
    data = bytearray(b"".join(node(1000 + 29 * number, distance=0x0502) for number in range(60))[cut:])
    stream, at = NodeFormat(), 0
    while not (found := stream.next_stretch(data, at)).packets:
        at = found.end
    assert at % 5 == -cut % 5


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("angle", "told"), [(30 * 64, False), (30 * 64 + 1, True)])
def test_a_mark_is_told_where_it_stands_elsewhere_than_at_0(angle: int, side: int, told: bool) -> None:
    """30 degrees from it, and more."""
    marked = node(side * angle % TURN, start=True)
    assert list(NodeFormat().headings(arrived(marked, 1, 0))) == [side * angle % TURN | BEGINS * told]


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("off", "believed"), [(0, True), (30 * 64, True), (30 * 64 + 1, False)])
@pytest.mark.parametrize("place", [61 * 64, 100 * 64, 260 * 64])
def test_a_mark_stands_within_30_degrees_of_where_the_first_one_did(
    place: int, off: int, believed: bool, side: int
) -> None:
    """Or of 0. The node itself continues the one before."""
    second = place + side * off
    turn = [node(angle % TURN) for angle in range(place + 64, second + TURN, 7 * 64)]
    stream = in_step(place - 7)
    assert stream.run(bytearray(node(place, start=True) + b"".join(turn)), 0).packets == (
        (Block(5, len(turn) + 1),)
    )
    # As an array, and alone.
    for behind in (b"", b"".join(node(second + 7 * k) for k in range(1, 30))):
        went_on = deepcopy(stream).run(bytearray(node(second, start=True) + behind), 0)
        assert bool(went_on.packets) is believed


def noise_before(data: bytearray, stream: NodeFormat | None = None) -> int:
    """How far bytes are taken for noise, before nodes or what cannot be decided."""
    stream, at = stream or NodeFormat(), 0
    while not (stretch := stream.next_stretch(data, at)).packets and stretch.end > at:
        at = stretch.end
    return at


LEAPING = b"".join(map(node, (0, 5000, 10000, 15000)))
"""Nodes, but none continues the one before."""
CHAIN = b"".join(node(3000 + 7 * k) for k in range(40))
BESIDE_THE_BEAM = triangulated([50 + k for k in range(40)], [0, 0, 4300, 0, -700] * 8)
"""A chain whose angles leap."""


@pytest.mark.parametrize(("chain", "step"), [(CHAIN, 1), (BESIDE_THE_BEAM, 7)])
def test_a_chain_is_found_wherever_it_begins_behind_what_is_none(chain: bytes, step: int) -> None:
    """As if each byte was tried, though many are looked at together."""
    for filled in [*range(920, 1060, step), *range(1960, 2060, step)]:
        noise = LEAPING * 3 + bytes(filled)
        assert noise_before(bytearray(noise + chain)) == len(noise)


@pytest.mark.parametrize(("damaged", "count", "found"), [(1, 3, False), (1, 4, True), (2, 5, True), (3, 4, True)])
def test_behind_a_few_damaged_nodes_four_that_continue_are_enough(damaged: int, count: int, found: bool) -> None:
    """They are where nodes are due, and what is behind them is damaged, too."""
    stream, first = in_step(3000), 3000 + 7 * (damaged + 1)
    nodes = b"".join(node(first + 7 * k) for k in range(count))
    data = bytearray(bytes(5 * damaged) + nodes + bytes(200))
    assert (noise_before(data, stream) == 5 * damaged) is found


@pytest.mark.parametrize("filled", [20, 1000])
def test_a_chain_is_not_passed_over_wherever_the_bytes_end(filled: int) -> None:
    noise = LEAPING * 3 + bytes(filled)
    for size in range(0, len(CHAIN), 3):
        assert len(noise) - 100 <= noise_before(bytearray(noise + CHAIN[:size])) <= len(noise), size
