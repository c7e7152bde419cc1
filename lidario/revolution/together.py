"""Bytes that were read together are parsed in slices; the runs of packets that these give are joined to one.

A program that blocked its event loop finds seconds of a stream at once, and they are parsed in slices, all with
the time at which they were read. Seen alone, the packets of the first slice seem to have come late by all that
stands behind them, and a whole revolution seems to have a hole in it. Joined, `Assembler` sees how much was
measured after each packet, and dates it by that.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from typing import Final

from lidario.wire.blocks import Block, join_blocks
from lidario.wire.events import EARLIEST_NS, Arrival, Packets

SLICE: Final = 2048
"""Bytes that are parsed in one step. Those that look most like packets and are none take 2 us each."""


def slices(
    data: bytes, now: int, arrivals: Sequence[Arrival] = (), most: int = SLICE
) -> Iterator[tuple[memoryview, int, Sequence[Arrival]]]:
    """What was received, in pieces of so many bytes: the arguments of `Link.receive_data`, for each."""
    view = memoryview(data)
    for begin in range(0, len(view), most):
        end = min(begin + most, len(view))
        inside = bisect_right(arrivals, begin, key=_bytes_of), bisect_left(arrivals, end, key=_bytes_of)
        came = [(size - begin, at_ns) for size, at_ns in arrivals[inside[0] : inside[1]]]
        yield view[begin:end], arrivals[inside[1]][1] if inside[1] < len(arrivals) else now, came


def join_reads(
    reads: Sequence[tuple[bytes, int]], earliest_ns: int = EARLIEST_NS
) -> tuple[bytes, int, list[Arrival]]:
    """Reads and their times as one piece, as `Receiver.data_received` takes it; at least one.

    Args:
        reads: The bytes, and when they were read. Time never goes back, whatever a message says.
        earliest_ns: When what came before was read.
    """
    arrivals: list[Arrival] = []
    size = 0
    for data, at_ns in reads:
        size += len(data)
        earliest_ns = max(earliest_ns, at_ns)
        if arrivals and arrivals[-1][1] == earliest_ns:
            arrivals.pop()
        arrivals.append((size, earliest_ns))
    arrivals.pop()
    return b"".join([data for data, _ in reads]), earliest_ns, arrivals


def joined(runs: Sequence[Packets]) -> Packets:
    """Packets that follow each other, as if they had been reported together; at least one run."""
    if len(runs) == 1:
        return runs[0]
    data: list[bytes] = []
    blocks: list[Block] = []
    arrivals: list[Arrival] = []
    skips: list[tuple[int, int]] = []
    before = 0
    for run in runs:
        data.append(run.data)
        join_blocks(blocks, run.blocks)
        if run.skips:
            skips += [(before + at, size) for at, size in run.skips]
        apart = run.apart
        for count, at_ns in run.arrivals:
            if arrivals and arrivals[-1][1] == at_ns and not apart:
                arrivals.pop()
            arrivals.append((before + count, at_ns))
            apart = False
        before = arrivals[-1][0]
    return Packets(b"".join(data), tuple(blocks), tuple(arrivals), tuple(skips), cut=runs[-1].cut)


def _bytes_of(arrival: Arrival) -> int:
    return arrival[0]
