"""Which five bytes are a node, alone and in company."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lidario.families.rplidar.nodes import NodeFormat
from lidario.families.rplidar.simulated.packers import pack_standard
from lidario.wire.blocks import Block
from lidario.wire.formats import NO_PACKET
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


def test_the_two_check_bits() -> None:
    stream = NodeFormat()
    for first in range(4):
        for second in range(2):
            size = stream.measure(bytearray((first, second, 0, 0, 0)), 0)
            assert size == (5 if first in (1, 2) and second == 1 else NO_PACKET)
    assert stream.measure(bytearray(b"\x02"), 0) == 0


@pytest.mark.parametrize(
    ("angle", "start", "believed"),
    [
        (0, True, True),
        (29 * 64, True, True),
        (31 * 64, True, True),
        (180 * 64, True, True),
        (331 * 64, True, True),
        (TURN - 1, False, True),
        (TURN, False, False),
        (0x7FFF, False, False),
        (180 * 64, False, True),
    ],
)
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
@pytest.mark.parametrize("base", [5000, 100, TURN - 50])
def test_a_node_in_step_continues_the_one_before(base: int, behind: int, follows: bool) -> None:
    """A little backwards too: models that triangulate correct their angles by so much."""
    stream = in_step(base)
    data = bytearray(node((base + behind) % TURN))
    assert stream.run(data, 0).packets == ((Block(5, 1),) if follows else ())


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


def test_angles_that_stand_still_lose_against_those_that_turn() -> None:
    """Distances of a smooth wall, read as angles in the wrong phase, stand or fall."""
    turning = b"".join(node(1000 + 7 * k, distance=0x0303) for k in range(60))
    for shift in range(1, 5):
        data = bytearray(turning[shift:])
        stretch = NodeFormat().next_stretch(data, 0)
        while not stretch.packets:
            assert stretch.end > 0
            del data[: stretch.end]
            stretch = NodeFormat().next_stretch(data, 0)
        assert len(data) % 5 == 0


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


@pytest.mark.parametrize("count", [1, 5, 15, 16, 40])
def test_headings_are_the_angles(count: int) -> None:
    angles = [(57 * k * k) % TURN for k in range(count)]
    raw = b"".join(map(node, angles))
    assert list(NodeFormat().headings(arrived(raw, count, 0))) == angles
