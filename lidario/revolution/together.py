"""Divides bytes that were read together into slices, and joins the runs of packets that these give.

A program that blocked its event loop reads seconds of a stream at once. They are parsed in slices, all with the
time of that read. Taken alone, the packets of the first slice would seem to be late by all that follows them, and a
whole revolution would seem to have a gap. Joined to one run, `Assembler` sees how much was measured after each
packet, and dates it by that.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from typing import Final

from lidario.wire.blocks import Block, join_blocks
from lidario.wire.events import EARLIEST_NS, Arrival, Packets

SLICE: Final = 2048
"""Bytes that are parsed in one step. Noise that looks most like packets takes 2 us a byte."""


def slices(
    data: bytes, now: int, arrivals: Sequence[Arrival] = (), most: int = SLICE
) -> Iterator[tuple[memoryview, int, Sequence[Arrival]]]:
    """Divide received bytes into pieces of `most` bytes; yields the arguments of `Link.receive_data` for each."""
    view = memoryview(data)
    for begin in range(0, len(view), most):
        end = min(begin + most, len(view))
        inside = bisect_right(arrivals, begin, key=_bytes_of), bisect_left(arrivals, end, key=_bytes_of)
        came = [(size - begin, at_ns) for size, at_ns in arrivals[inside[0] : inside[1]]]
        yield view[begin:end], arrivals[inside[1]][1] if inside[1] < len(arrivals) else now, came


def join_reads(
    reads: Sequence[tuple[bytes, int]], earliest_ns: int = EARLIEST_NS
) -> tuple[bytes, int, list[Arrival]]:
    """Join reads and their times to one piece, as `Receiver.data_received` takes it.

    Args:
        reads: At least one read: its bytes, and when it was read. Times that go back are raised to the one before.
        earliest_ns: Time of the read before these.
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
    """Join at least one run of packets that follow each other to one run."""
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
