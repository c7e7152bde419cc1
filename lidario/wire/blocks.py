"""How packets of different sizes lie in one piece of bytes.

If every packet of a format has the same size, the place of each follows from its number. If packets state their own
sizes, the parser must go from packet to packet. It does so once, and keeps the result as blocks: a few pairs of a
size and a number of packets, since most packets of a revolution have the same size. Blocks can be joined and
divided without reading the bytes again.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple


class Block(NamedTuple):
    """Packets of one size that follow each other."""

    size: int  # bytes of each
    packets: int  # how many there are


def join_blocks(into: list[Block], more: Iterable[Block]) -> None:
    """Add blocks at the end of others; neighbours of one size become one block, as if parsed together."""
    for block in more:
        if into and into[-1].size == block.size:
            block = Block(block.size, into.pop().packets + block.packets)
        into.append(block)


def some_blocks(blocks: Sequence[Block], begin: int, end: int) -> tuple[Block, ...]:
    """The packets from number `begin` to before number `end`."""
    if len(blocks) == 1:
        return (Block(blocks[0].size, end - begin),) if begin < end else ()
    found: list[Block] = []
    first = 0
    for block in blocks:
        last = first + block.packets
        if begin <= first and last <= end:
            found.append(block)
        elif begin < last and first < end and begin < end:
            found.append(Block(block.size, min(end, last) - max(begin, first)))
        first = last
    return tuple(found)


def packet_offsets(blocks: Sequence[Block]) -> Sequence[int]:
    """Offset at which each packet begins, and at the end that at which the last one ends."""
    if len(blocks) == 1:
        size, count = blocks[0]
        return range(0, size * (count + 1), size)
    offsets: list[int] = []
    at = 0
    for size, count in blocks:
        offsets += range(at, at + size * count, size)
        at += size * count
    offsets.append(at)
    return offsets
