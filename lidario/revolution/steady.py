"""The clean path: revolutions of an undisturbed stream, as many as end together, decoded as one block.

Live that is one. A file, or a program that blocked its event loop, brings many at once, and one decode of all costs
little more than one of each: most of the cost is in the calls of numpy, not in the samples. The scans are views
into the arrays of the block.

What is found is what `Assembler` finds with one revolution after the other, to the last bit. Whatever may be a gap,
a restart, or a late arrival is not judged here: `decode_block` then returns None and has changed nothing.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

from lidario.families.base import Decoder, SteadySamples, Stream
from lidario.revolution.build import DatedRevolution, turned_by
from lidario.revolution.clock import NOISE, Beginning, RevolutionClock
from lidario.revolution.ended import UNEVEN, hides_a_turn
from lidario.revolution.partial import PartialRevolution, SampleArrays, joined, part_of
from lidario.revolution.seam import Split
from lidario.revolution.timing import earliest_ns
from lidario.wire.blocks import packet_offsets, some_blocks
from lidario.wire.events import Packets


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


def is_ready(stream: Stream, partial: PartialRevolution, clock: RevolutionClock) -> bool:
    """Whether enough is known of the revolution in the making, and of the one before, for a block to begin."""
    known = partial.whole and not (partial.moved or partial.behind_gap or partial.carried_packets)
    return known and stream.sample_ns > 0 and clock.last is not None


def decode_block(
    stream: Stream,
    partial: PartialRevolution,
    event: Packets,
    offsets: Sequence[int],
    splits: Sequence[Split],
    first: int,
    *,
    decoder: Decoder,
    clock: RevolutionClock,
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
        decoder: What decodes it.
        clock: The revolutions so far.
        byte_ns: Nanoseconds that a byte takes on the line.
    """
    marked, seam, last = splits[0].marked, splits[0].seam, splits[-1].packet
    for split in splits:
        # A mark that ended no revolution moved the seam: the decoder takes only one.
        other_seam = not marked and split.seam != seam
        if split.broken or split.moved or split.marked != marked or other_seam:
            return None
    if not partial.runs and splits[0].packet == first:
        return None
    runs = partial.runs
    if last > first:
        runs = [*runs, part_of(event, first, last, offsets, stream.format, stream.sample_ns)]
    packets = joined(runs)
    before = packets.count - last
    ends = [before + split.packet for split in splits]
    room = 0 if partial.carried is None else len(partial.carried.angle)
    following = event.data[offsets[last] : offsets[last + 1]]
    samples = decoder.decode_steady(packets, following, ends, room, None if marked else seam)
    if samples is None:
        return None
    reads = [(room + samples.ends[complete - 1], at_ns) for complete, at_ns in packets.arrivals]
    if last > first:
        # What stands behind the end of a revolution was there already. So late was the end: rounded once for each.
        complete, now = event.arrivals[bisect_left(event.arrivals, last, key=itemgetter(0))]
        reads[-1] = reads[-1][0] + stream.format.samples_in(some_blocks(event.blocks, last, complete)), now
    here = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
    if partial.carried is not None:
        here.begin_with(partial.carried)
    reads.insert(0, (room, partial.carried_ns))
    offsets = packet_offsets(packets.blocks) if byte_ns else ()
    revolutions, last_ns = _dated(stream, here, samples, ends, reads, offsets, byte_ns, clock.usual_ns)
    if not revolutions or not clock.is_followed(revolutions):
        return None
    latest = revolutions[-1]
    coming = PartialRevolution(whole=True, seam=splits[-1].seam, behind_gap=False, even=True, carried_ns=last_ns)
    used = room + samples.before_seam[-1]
    if used < len(here.angle):
        coming.carried = here.part(used)
    beginning = Beginning(
        latest.start_ns,
        over=0.0,
        revolution_ns=latest.revolution_ns,
        revolution_packets=samples.revolution_packets[-1],
        packet_ns=latest.revolution_ns / samples.revolution_packets[-1],
        packets=ends[-1] - (ends[-2] if len(ends) > 1 else 0),
        lost=0,
        broken=False,
        spanned_ns=latest.spanned_ns,
    )
    return SteadyBlock(revolutions, last - first, coming, beginning, samples)


def _dated(
    stream: Stream,
    here: SampleArrays,
    samples: SteadySamples,
    ends: Sequence[int],
    reads: Sequence[tuple[int, int]],
    offsets: Sequence[int],
    byte_ns: float,
    usual_ns: float,
) -> tuple[list[DatedRevolution], int]:
    """Divide the samples among the revolutions, and tell when each was measured, by all that came of it.

    Args:
        stream: The stream.
        here: The samples, behind those that were there before.
        samples: What they were decoded to.
        ends: Packets up to the end of each revolution.
        reads: How many samples were there, and when, one read after the other; those that were there before first.
        offsets: Where packets begin; empty where bytes take no time.
        byte_ns: As for `decode_block`, and so is the next one.
        usual_ns: What a revolution took before.

    Returns:
        The revolutions, and when the last packet of them came. None where one came late, or took more or less time
        than its angles tell: `Assembler` decides about those.
    """
    sample_ns, rpms = stream.sample_ns, samples.reported_rpm
    turned = SampleArrays(turned_by(here.angle, stream.zero_offset_deg), here.distance, here.intensity)
    found: list[DatedRevolution] = []
    (there, at_ns), read = reads[0], 1
    room, begin, packet = there, 0, 0
    for number, end in enumerate(ends):
        seam_at, stop = room + samples.before_seam[number], room + samples.ends[end - 1]
        earliest = at_ns - (there - 1 - begin) * sample_ns if there > begin else math.inf
        while reads[read][0] < stop:
            there, at_ns = reads[read]
            earliest = min(earliest, at_ns - (there - 1 - begin) * sample_ns)
            read += 1
        there, at_ns = reads[read]
        read += there == stop
        there, at_ns = stop, at_ns - round((there - stop) * sample_ns)
        earliest = min(earliest, at_ns - (stop - 1 - begin) * sample_ns)
        wire_ns = (offsets[end] - offsets[packet]) / (end - packet) * byte_ns if offsets else 0.0
        start_ns = earliest_ns(earliest, sample_ns, wire_ns)
        spanned_ns, turn_ns = (seam_at - begin) * sample_ns, samples.revolution_samples[number] * sample_ns
        if (
            hides_a_turn(at_ns - start_ns - spanned_ns, usual_ns, gap=False)
            or spanned_ns > UNEVEN * turn_ns
            or start_ns - round(at_ns - spanned_ns) > NOISE * turn_ns
        ):
            return [], 0
        rpm = rpms[number] if rpms else math.nan
        found.append(DatedRevolution(turned.part(begin, seam_at), start_ns, spanned_ns, turn_ns, rpm))
        begin, packet, usual_ns = seam_at, end, turn_ns
    return found, at_ns
