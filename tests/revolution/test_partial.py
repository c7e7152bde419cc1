"""The revolution in the making: what is carried into it, and where its samples are missing."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from lidario.families.base import DecodedRevolution, Samples
from lidario.families.rplidar.formats import DenseFormat
from lidario.families.ydlidar.formats import PointCloud
from lidario.revolution.partial import PartialRevolution, SampleArrays, part_of
from lidario.wire.blocks import Block, join_blocks
from lidario.wire.events import Packets
from lidario.wire.formats import StreamFormat

NOTHING = np.empty(0, np.float32)
SOME = SampleArrays(np.zeros(20, np.float32), np.zeros(20, np.float32), None)
DECODED = Samples(
    NOTHING, NOTHING, None, range(40, 201, 40), [DecodedRevolution(200, 80.0, 3200.0)], 1, 2, gaps=[(80, 40)]
)


def test_where_samples_are_missing() -> None:
    partial = PartialRevolution(whole=True, carried=SOME)
    assert partial.gaps(DECODED, 20, 200, revoked=False) == [(100, 40)]
    assert partial.gaps(DECODED, 20, 100, revoked=False) == []  # behind its end
    partial.skipped_behind_carried = 7
    assert partial.gaps(DECODED, 20, 200, revoked=False) == [(20, 7), (100, 40)]
    # Without the samples that were carried over, it begins behind that gap.
    assert partial.gaps(DECODED, 20, 200, revoked=True) == [(80, 40)]
    assert partial.gaps(replace(DECODED, certain=False), 20, 200, revoked=False) is None


def lists(arrays: SampleArrays) -> list[list[float] | None]:
    return [None if each is None else each.tolist() for each in (arrays.angle, arrays.distance, arrays.intensity)]


@pytest.mark.parametrize("strong", [False, True])
def test_what_is_carried_over_comes_first(strong: bool) -> None:
    def some(first: int, count: int) -> SampleArrays:
        numbers = np.arange(first, first + count)
        strength = numbers.astype(np.uint8) if strong else None
        return SampleArrays(numbers.astype(np.float32), 10 * numbers.astype(np.float32), strength)

    whole = some(0, 6)
    assert lists(whole.part(2, 5)) == [[2, 3, 4], [20, 30, 40], [2, 3, 4] if strong else None]
    whole.begin_with(some(7, 2))
    expected = [7, 8, 2, 3, 4, 5]
    assert lists(whole) == [expected, [10 * each for each in expected], expected if strong else None]


def test_when_its_reads_came_is_known_where_its_beginning_was_read() -> None:
    packets = Packets(b"....", (Block(1, 4),), ((1, 600), (4, 900)))
    known = PartialRevolution(whole=True, carried_ns=400, begun_ns=500, ended_ns=1200)
    assert [*known.reads_ns(packets)] == [400, 500, 600, 900, 1200]
    assert not PartialRevolution(whole=True, carried_ns=400, ended_ns=1200).reads_ns(packets)


def blocks_of(sizes: Sequence[int], *, one_a_size: bool) -> tuple[Block, ...]:
    """A block for each packet, or for all of one size that follow each other: that is what a link tells."""
    single = [Block(size, 1) for size in sizes]
    blocks: list[Block] = []
    join_blocks(blocks, single)
    return tuple(blocks if one_a_size else single)


@pytest.mark.parametrize("one_a_size", [False, True])
@pytest.mark.parametrize(("wire", "counts"), [(DenseFormat(), [40] * 6), (PointCloud(), [1, 40, 40, 7, 40, 16])])
def test_a_part_comes_as_much_earlier_as_what_was_measured_behind_it(
    wire: StreamFormat, counts: list[int], one_a_size: bool
) -> None:
    sizes = [84 if each == 40 and wire.samples == 40 else 10 + 2 * each for each in counts]
    blocks = blocks_of(sizes, one_a_size=one_a_size)
    data = np.random.default_rng(1).bytes(sum(sizes))
    packets = Packets(data, blocks, ((2, 5000), (6, 9000)))
    for begin in range(6):
        for end in range(begin + 1, 7):
            part = part_of(packets, begin, end, None, wire, 3.0)
            late = 3 * sum(counts[end : 2 if end <= 2 else 6])
            last = (end - begin, (5000 if end <= 2 else 9000) - late)
            assert part.arrivals == (((2 - begin, 5000), last) if begin < 2 < end else (last,))
            assert part.data == data[sum(sizes[:begin]) : sum(sizes[:end])]
            assert [size for size, count in part.blocks for _ in range(count)] == sizes[begin:end]
