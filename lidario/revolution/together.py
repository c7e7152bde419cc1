"""Runs of packets that were read together, joined to one.

A program that blocked its event loop finds seconds of a stream at once, and `Link` parses them in slices, all with
the time at which they were read. Seen alone, the packets of the first slice seem to have come late by all that
stands behind them, and a whole revolution seems to have a hole in it. Joined, `Assembler` sees how much was
measured after each packet, and dates it by that.
"""

from __future__ import annotations

from collections.abc import Sequence

from lidario.wire.blocks import Block, join_blocks
from lidario.wire.events import Arrival, Event, Packets

__all__ = ["join_runs"]


def join_runs(events: Sequence[Event]) -> list[Event]:
    """The same events, where runs of packets that follow each other are one."""
    joined: list[Event] = []
    runs: list[Packets] = []
    for event in events:
        if isinstance(event, Packets):
            runs.append(event)
            continue
        joined += _as_one(runs)
        runs.clear()
        joined.append(event)
    joined += _as_one(runs)
    return joined


def _as_one(runs: Sequence[Packets]) -> list[Packets]:
    if len(runs) <= 1:
        return list(runs)
    blocks: list[Block] = []
    join_blocks(blocks, [block for run in runs for block in run.blocks])
    arrivals: list[Arrival] = []
    before = 0
    for run in runs:
        for count, at_ns in run.arrivals:
            if arrivals and arrivals[-1][1] == at_ns:
                arrivals.pop()
            arrivals.append((before + count, at_ns))
        before = arrivals[-1][0]
    return [Packets(b"".join([run.data for run in runs]), tuple(blocks), tuple(arrivals))]
