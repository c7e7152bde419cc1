"""The clean path: revolutions of an undisturbed stream, as many as end together, decoded as one block.

Live that is one. A file, or a program that blocked its event loop, brings many at once, and one decode of all costs
little more than one of each: most of the cost is in the calls of numpy, not in the samples. The scans are views
into the arrays of the block.

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
from lidario.revolution.clock import NOISE, Beginning, RevolutionClock
from lidario.revolution.ended import BROKEN_SHARE, UNEVEN
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
    clock: RevolutionClock,
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
        clock: The revolutions so far.
        last_spanned_ns: What the revolution before took; 0 when that is not known.
        byte_ns: Nanoseconds that a byte takes on the line.
    """
    marked, seam, last = splits[0].marked, splits[0].seam, splits[-1].packet
    if any(split.broken or split.moved or split.marked != marked for split in splits):
        return None
    if not marked and any(split.seam != seam for split in splits):
        # A mark that ended no revolution moved the seam: the decoder takes only one.
        return None
    if not partial.runs and splits[0].packet == first:
        return None
    runs = partial.runs
    if last > first:
        runs = [*runs, part_of(event, first, last, offsets, stream.format, stream.sample_ns)]
    packets = joined(runs)
    before = packets.count - last
    ends = [before + split.packet for split in splits]
    room = 0 if partial.carried is None else len(partial.carried)
    following = event.data[offsets[last] : offsets[last + 1]]
    samples = stream.decoder.decode_steady(packets, following, ends, room, None if marked else seam)
    if samples is None:
        return None
    bounds = [0, *(room + end for end in samples.before_seam)]
    there = [(room + samples.ends[complete - 1], at_ns) for complete, at_ns in packets.arrivals]
    if last > first:
        # What stands behind the end of a revolution was there already. So late was the end: rounded once for each.
        complete, now = next(each for each in event.arrivals if each[0] >= last)
        there[-1] = there[-1][0] + stream.format.samples_in(some_blocks(event.blocks, last, complete)), now
    late_ns = [each * byte_ns for each in _packet_bytes(packets, ends, vary=bool(byte_ns))]
    stops = [room + samples.ends[end - 1] for end in ends]
    starts, arrived = _dated((room, partial.carried_ns), there, bounds, stops, stream.sample_ns, late_ns)
    turns = _turns(stream.sample_ns, samples, bounds, starts, arrived, clock, last_spanned_ns)
    if turns is None:
        return None
    return _block(stream, partial, samples, bounds, starts, turns, arrived[-1], ends, last - first, splits[-1].seam)


def _packet_bytes(packets: Packets, ends: Sequence[int], *, vary: bool) -> list[float]:
    """Mean bytes of a packet, for each revolution; with `vary` false, the mean of all revolutions."""
    if not vary or len(packets.blocks) == 1:
        return [len(packets.data) / packets.count] * len(ends)
    offsets = packet_offsets(packets.blocks)
    return [(offsets[end] - offsets[begin]) / (end - begin) for begin, end in pairwise([0, *ends])]


def _dated(
    carried: tuple[int, int],
    reads: Sequence[tuple[int, int]],
    bounds: Sequence[int],
    stops: Sequence[int],
    sample_ns: float,
    late_ns: Sequence[float],
) -> tuple[list[int], list[int]]:
    """When the first sample of each revolution was measured, by all that came of it, and when its last packet came.

    Args:
        carried: Samples that were there before, and when they came.
        reads: Samples that were there, and when, one read after the other.
        bounds: The first sample of each revolution.
        stops: The one behind the last packet of each.
        sample_ns: Nanoseconds a sample.
        late_ns: What delays the packets of each on the line.
    """
    starts, arrived, at = list[int](), list[int](), 0
    there, at_ns = carried
    for begin, stop, late in zip(bounds, stops, late_ns, strict=False):
        estimates = [at_ns - (there - 1 - begin) * sample_ns] if there > begin else []
        while reads[at][0] < stop:
            there, at_ns = reads[at]
            estimates.append(at_ns - (there - 1 - begin) * sample_ns)
            at += 1
        there, at_ns = reads[at]
        at += there == stop
        there, at_ns = stop, at_ns - round((there - stop) * sample_ns)
        estimates.append(at_ns - (stop - 1 - begin) * sample_ns)
        starts.append(earliest_ns(estimates, sample_ns, late))
        arrived.append(at_ns)
    return starts, arrived


def _turns(
    sample_ns: float,
    samples: SteadySamples,
    bounds: Sequence[int],
    starts: Sequence[int],
    arrived: Sequence[int],
    clock: RevolutionClock,
    last_spanned_ns: float,
) -> list[float] | None:
    """What each revolution took, by its angles.

    None where one came late, or took more or less time than its angles tell. `Assembler` decides about those.
    """
    spanned = [(end - begin) * sample_ns for begin, end in pairwise(bounds)]
    turns = [each * sample_ns for each in samples.revolution_samples]
    ordinary_ns = last_spanned_ns or spanned[0]
    for at_ns, start_ns, spanned_ns, turn_ns in zip(arrived, starts, spanned, turns, strict=True):
        if (
            at_ns - start_ns > spanned_ns + BROKEN_SHARE * ordinary_ns
            or spanned_ns > UNEVEN * turn_ns
            or start_ns - round(at_ns - spanned_ns) > NOISE * turn_ns
        ):
            return None
        ordinary_ns = spanned_ns
    return turns if clock.is_followed(starts, turns) else None


def _block(
    stream: Stream,
    partial: PartialRevolution,
    samples: SteadySamples,
    bounds: Sequence[int],
    starts: Sequence[int],
    turns: Sequence[float],
    last_ns: int,
    ends: Sequence[int],
    used: int,
    seam: int,
) -> SteadyBlock:
    """Divide the arrays among the revolutions."""
    here = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
    if partial.carried is not None:
        here.begin_with(partial.carried)
    following = PartialRevolution(whole=True, seam=seam, behind_gap=False, even=True, carried_ns=last_ns)
    if bounds[-1] < len(here):
        following.carried = here.part(bounds[-1])
    turned = SampleArrays(turned_by(here.angle, stream.zero_offset_deg), here.distance, here.intensity)
    reported = samples.reported_rpm or [math.nan] * len(starts)
    revolutions = [
        DatedRevolution(turned.part(begin, end), start_ns, (end - begin) * stream.sample_ns, turn_ns, rpm)
        for (begin, end), start_ns, turn_ns, rpm in zip(pairwise(bounds), starts, turns, reported, strict=True)
    ]
    beginning = Beginning(
        starts[-1],
        over=0.0,
        revolution_ns=turns[-1],
        revolution_packets=samples.revolution_packets[-1],
        packet_ns=turns[-1] / samples.revolution_packets[-1],
        packets=ends[-1] - (ends[-2] if len(ends) > 1 else 0),
        lost=0,
        broken=False,
        spanned_ns=revolutions[-1].spanned_ns,
    )
    return SteadyBlock(revolutions, used, following, beginning, samples)
