"""Several revolutions of an undisturbed stream, decoded as one block.

A file, or a program that blocked its event loop, brings many revolutions at once. Where nothing is missing among
them, one decode of all costs little more than one of each: most of the cost is in the calls of numpy, not in the
samples. The scans are then views into the arrays of the block.

What is found is what `Assembler` finds with one revolution after the other, to the last bit. Whatever may be a gap,
a restart, or a late arrival is not judged here: `decode_block` then returns None and has changed nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from lidario.families.base import SteadySamples, Stream
from lidario.revolution.build import DatedRevolution, turned_by
from lidario.revolution.count import NOISE, Beginning, RevolutionCount
from lidario.revolution.judge import BROKEN_SHARE, UNEVEN, is_complete
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.revolution.seam import Split
from lidario.revolution.timing import earliest_ns
from lidario.scan import read_only
from lidario.wire.blocks import Block, join_blocks, packet_offsets, some_blocks
from lidario.wire.events import Arrival, Packets

__all__ = ["SteadyBlock", "decode_block", "is_ready"]


class SteadyBlock(NamedTuple):
    """The revolutions of a block.

    Attributes:
        revolutions: All of them.
        packets: How many packets of the event were decoded with them.
        next: What is known of the revolution that follows.
        beginning: What the last one tells for counting.
        samples: What the decoder found; not yet settled.
    """

    revolutions: list[DatedRevolution]
    packets: int
    next: PartialRevolution
    beginning: Beginning
    samples: SteadySamples


def is_ready(stream: Stream, partial: PartialRevolution, count: RevolutionCount) -> bool:
    """Whether enough is known of the revolution in the making, and of the one before, for a block to begin."""
    known = partial.whole and not (partial.moved or partial.behind_gap or partial.carried_packets)
    return known and stream.sample_ns > 0 and count.last is not None


def decode_block(
    stream: Stream,
    partial: PartialRevolution,
    event: Packets,
    offsets: Sequence[int],
    splits: Sequence[Split],
    first: int,
    *,
    seam: int | None,
    count: RevolutionCount,
    last_spanned_ns: float,
    byte_ns: float,
) -> SteadyBlock | None:
    """Decode the revolution in the making and those that end in an event, if nothing is missing in any.

    It must be known that a block can begin (`is_ready`).

    Args:
        stream: The stream.
        partial: The revolution in the making.
        event: The packets that came.
        offsets: Where each of them begins (`packet_offsets`).
        splits: Where revolutions end in it; at least one.
        first: The first packet of the event that was not yet used.
        seam: Heading at which revolutions begin; None where the device marks their first packet.
        count: The revolutions so far.
        last_spanned_ns: What the revolution before took; 0 when that is not known.
        byte_ns: Nanoseconds that a byte takes on the line.
    """
    sample_ns, wire = stream.sample_ns, stream.format
    marked = splits[0].marked
    if len(event.arrivals) != 1:
        return None
    if any(split.broken or split.moved or split.marked != marked for split in splits):
        return None
    before, arrivals = 0, list[Arrival]()
    for run in partial.runs:
        arrivals += [(before + packets, at_ns) for packets, at_ns in run.arrivals]
        before += run.count
    ends = [before + split.packet - first for split in splits]
    if not ends[0]:
        return None
    last = splits[-1].packet
    packets = _joined(partial, event, offsets, first, last, ends[-1])
    room = 0 if partial.carried is None else len(partial.carried)
    following = event.data[offsets[last] : offsets[last + 1]]
    samples = stream.decoder.decode_steady(packets, following, ends, room, None if marked else seam)
    if samples is None:
        return None

    # What stands behind the end of a revolution was measured after it and was there already: so late was the end.
    behind = wire.samples_in(some_blocks(event.blocks, last, event.count))
    total = samples.packet_ends[-1]
    now = event.arrivals[0][1]
    arrived = [now - round((behind + total - end) * sample_ns) for end in samples.packet_ends]
    if splits[0].packet == first:
        arrived[0] = partial.last_ns
    else:
        arrivals.append((ends[0], arrived[0]))
    packet_bytes = [len(packets.data) / packets.count] * len(ends)
    if byte_ns and len(packets.blocks) > 1:
        bounds = [0, *(packet_offsets(packets.blocks)[end] for end in ends)]
        packet_bytes = [
            (to - begin) / (end - start)
            for (begin, to), (start, end) in zip(pairwise(bounds), pairwise([0, *ends]), strict=True)
        ]

    bounds = [0, *(room + end for end in samples.before_seam)]
    estimates = [partial.carried_ns - (room - 1) * sample_ns] if room else []
    for complete, at_ns in arrivals:
        known = (
            samples.packet_ends[0]
            if complete == ends[0]
            else wire.samples_in(some_blocks(packets.blocks, 0, complete))
        )
        estimates.append(at_ns - (room + known - 1) * sample_ns)
    starts = [earliest_ns(estimates, sample_ns, packet_bytes[0] * byte_ns)]
    for at in range(1, len(ends)):
        carried = room + samples.packet_ends[at - 1] - bounds[at]
        fresh = samples.packet_ends[at] - samples.packet_ends[at - 1]
        estimates = [arrived[at] - (carried + fresh - 1) * sample_ns]
        if carried:
            estimates.append(arrived[at - 1] - (carried - 1) * sample_ns)
        starts.append(earliest_ns(estimates, sample_ns, packet_bytes[at] * byte_ns))

    spanned = [(end - begin) * sample_ns for begin, end in pairwise(bounds)]
    turns = [each * sample_ns for each in samples.revolution_samples]
    ordinary_ns = last_spanned_ns or spanned[0]
    for at, (start_ns, spanned_ns, turn_ns) in enumerate(zip(starts, spanned, turns, strict=True)):
        # One that came late, or took more or less than its angles tell, is for those who judge it.
        if (
            arrived[at] - start_ns > spanned_ns + BROKEN_SHARE * ordinary_ns
            or spanned_ns > UNEVEN * turn_ns
            or start_ns - round(arrived[at] - spanned_ns) > NOISE * turn_ns
        ):
            return None
        ordinary_ns = spanned_ns
    intervals = count.intervals(starts, turns)
    if intervals is None:
        return None
    if math.isnan(intervals[0]) and is_complete(spanned[0], turns[0]):
        intervals[0] = spanned[0]
    return _block(stream, partial, samples, bounds, starts, spanned, intervals, arrived[-1], ends, last - first)


def _joined(
    partial: PartialRevolution, event: Packets, offsets: Sequence[int], first: int, last: int, count: int
) -> Packets:
    """The packets of the revolution in the making and those of the event up to the last split; no arrivals."""
    blocks: list[Block] = []
    for run in partial.runs:
        join_blocks(blocks, run.blocks)
    join_blocks(blocks, some_blocks(event.blocks, first, last))
    new = memoryview(event.data)[offsets[first] : offsets[last]]
    return Packets(b"".join([*(run.data for run in partial.runs), new]), tuple(blocks), ((count, 0),))


def _block(
    stream: Stream,
    partial: PartialRevolution,
    samples: SteadySamples,
    bounds: Sequence[int],
    starts: Sequence[int],
    spanned: Sequence[float],
    intervals: Sequence[float],
    last_ns: int,
    ends: Sequence[int],
    used: int,
) -> SteadyBlock:
    """Divide the arrays among the revolutions."""
    here = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
    if partial.carried is not None:
        here.begin_with(partial.carried, len(partial.carried))
    following = PartialRevolution(whole=True, behind_gap=False)
    if bounds[-1] < len(here):
        following.carried = here.part(bounds[-1])
        following.carried_ns = last_ns
    for array in (here.angle, here.distance, here.intensity):
        if array is not None:
            read_only(array)
    turned = SampleArrays(turned_by(here.angle, stream.zero_offset_deg), here.distance, here.intensity)
    reported = samples.reported_rpm or [math.nan] * len(starts)
    revolutions = [
        DatedRevolution(turned.part(begin, end), start_ns, spanned_ns, interval_ns, rpm)
        for (begin, end), start_ns, spanned_ns, interval_ns, rpm in zip(
            pairwise(bounds), starts, spanned, intervals, reported, strict=True
        )
    ]
    turn_ns = samples.revolution_samples[-1] * stream.sample_ns
    beginning = Beginning(
        starts[-1],
        over=0.0,
        revolution_ns=turn_ns,
        revolution_packets=samples.revolution_packets[-1],
        packet_ns=turn_ns / samples.revolution_packets[-1],
        packets=ends[-1] - (ends[-2] if len(ends) > 1 else 0),
        lost=0,
        broken=False,
    )
    return SteadyBlock(revolutions, used, following, beginning, samples)
