"""Dates revolutions that end within a read that has gaps: after a blocked event loop, a read holds several.

Only the end of a read has a time. A packet before it in the same read was measured earlier, by the time of all that
was measured since: of the packets that came, and of those that are missing among them. If the missing ones were
left out, a revolution in a read of a second would seem to end too late by what was lost behind it, as if another
one had passed unseen.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Final

from lidario.families.base import Decoder, Samples
from lidario.revolution.partial import part_of
from lidario.revolution.together import joined
from lidario.wire.blocks import Block, some_blocks
from lidario.wire.events import Packets
from lidario.wire.formats import StreamFormat

_MORE_THAN_PASSED: Final = 1.25
"""If more was measured than fits into this many times the time since the read before, the rotor may be faster."""

Ends = Mapping[int, int]
"""When revolutions ended, by the number of packets before the end; only those that `ends_within` finds."""


def ends_within(
    packets: Packets,
    begin: int,
    offsets: Sequence[int],
    ends: Sequence[int],
    unseen: Sequence[Packets],
    last_ns: int,
    decoder: Decoder,
    wire: StreamFormat,
    sample_ns: float,
    *,
    uneven: bool,
) -> Ends:
    """When revolutions ended within reads that have gaps behind.

    Args:
        packets: The packets.
        begin: How many of them the decoder has seen.
        offsets: Where each of them begins (`packet_offsets`).
        ends: How many packets come before the end of each revolution; ascending.
        unseen: Runs before them that the decoder has not seen either.
        last_ns: Arrival of the last packet before them.
        decoder: The decoder of the stream.
        wire: The format of the packets.
        sample_ns: Nanoseconds a sample; 0 if unknown, and then every packet has the time of its read.
        uneven: Whether it was seen (`FalsePackets`) that they do not advance evenly.
    """
    found, follower, seen = dict[int, int](), None, begin
    # If what came fills the time since the read before, nothing is missing: decoding each read twice would take a
    # third longer. Where packets did not advance evenly, some are.
    little_ns = -math.inf if uneven else wire.samples_in((Block(wire.ordinary, 1),)) * sample_ns / 2
    for complete, at_ns in packets.arrivals:
        if complete <= begin:
            last_ns = at_ns
            continue
        # An end right before `begin` counts if the packet before it came with the same read.
        before = begin - 1 if begin and packets.read_at(begin - 1) == at_ns else begin
        inside = ends[bisect_right(ends, before) : bisect_left(ends, complete)]
        lacking_ns = at_ns - last_ns - wire.samples_in(some_blocks(packets.blocks, begin, complete)) * sample_ns
        may_lack = inside and lacking_ns > little_ns
        if may_lack and not _is_whole(packets, max(inside[0] - 1, 0), complete, offsets, decoder, wire):
            # All packets are decoded in their order: the rotor may have stopped meanwhile.
            runs = [*unseen] if follower is None else []
            follower = follower or decoder.fork()
            if begin > seen:
                runs.append(part_of(packets, seen, begin, offsets, wire, sample_ns))
            if runs:
                follower.decode(joined(runs), packets.data[offsets[begin] : offsets[begin + 1]])
            samples = follower.decode(part_of(packets, begin, complete, offsets, wire, sample_ns), None)
            seen = complete
            measured = samples.ends[-1] + sum([skipped for _, skipped in samples.gaps])
            fits = measured * sample_ns <= _MORE_THAN_PASSED * (at_ns - last_ns)
            # If they only now show that arcs before were wrong, the revolution that ends was decoded with these.
            if samples.certain and samples.gaps and fits and not any(samples.revoked):
                behind = _measured_behind(samples, [place - begin for place in inside])
                # None of them had come with the read before, at `last_ns`.
                found |= {
                    place: max(last_ns, at_ns - round(count * sample_ns))
                    for place, count in zip(inside, behind, strict=True)
                }
        begin, last_ns = complete, at_ns
    return found


def _is_whole(
    packets: Packets, begin: int, end: int, offsets: Sequence[int], decoder: Decoder, wire: StreamFormat
) -> bool:
    """Whether nothing is missing from packet number `begin` to the one before `end`, which is the usual case."""
    last = end - 1
    if last == begin:
        return True
    before = part_of(packets, begin, last, offsets, wire, 0.0)
    return decoder.is_whole(before, packets.data[offsets[last] : offsets[end]])


def _measured_behind(samples: Samples, places: Sequence[int]) -> list[int]:
    """How many samples, with the missing ones, were measured from each place to the end of a read.

    Args:
        samples: The decoded packets of the read.
        places: The places, each as the number of packets before it.
    """
    before = [at for at, _ in samples.gaps]
    passed = list(accumulate([skipped for _, skipped in samples.gaps], initial=0))
    measured = [each + passed[bisect_left(before, each)] for each in samples.ends]
    return [measured[-1] - (measured[place - 1] if place else 0) for place in places]
