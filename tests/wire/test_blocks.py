"""Blocks of packets join and divide as the packets themselves do."""

from itertools import accumulate, pairwise

from hypothesis import given
from hypothesis import strategies as st

from lidario.wire.blocks import Block, join_blocks, packet_offsets, some_blocks

sizes = st.lists(st.sampled_from([12, 14, 90]), max_size=12)


def blocks_of(sizes: list[int]) -> list[Block]:
    blocks: list[Block] = []
    for size in sizes:
        join_blocks(blocks, [Block(size, 1)])
    return blocks


def sizes_in(blocks: tuple[Block, ...] | list[Block]) -> list[int]:
    return [size for size, packets in blocks for _ in range(packets)]


@given(sizes, sizes)
def test_joined_blocks_are_those_of_all_packets_together(some: list[int], more: list[int]) -> None:
    blocks = blocks_of(some)
    join_blocks(blocks, blocks_of(more))
    assert blocks == blocks_of(some + more)
    assert sizes_in(blocks) == some + more
    assert all(one.size != other.size for one, other in pairwise(blocks))


@given(sizes, st.data())
def test_some_of_the_packets(sizes: list[int], data: st.DataObject) -> None:
    begin = data.draw(st.integers(0, len(sizes)))
    end = data.draw(st.integers(begin, len(sizes)))
    assert sizes_in(some_blocks(blocks_of(sizes), begin, end)) == sizes[begin:end]


@given(sizes)
def test_offsets_are_the_sums_of_the_sizes(sizes: list[int]) -> None:
    assert list(packet_offsets(blocks_of(sizes))) == list(accumulate(sizes, initial=0))


def test_offsets_of_one_size_are_a_range() -> None:
    assert packet_offsets([Block(84, 1000)]) == range(0, 84_001, 84)
