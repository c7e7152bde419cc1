"""Reads that hold several revolutions, as behind a blocked event loop: when each of these ended.

Only the end of a read tells a time. What stands before it in the same read was measured earlier, by all that was
measured since: by what came, and by what is missing among it, which has taken its time, too. If that were left out,
a revolution in a read of a second would seem to have ended late by a tenth of what was lost, and a turn to have
passed unseen.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

from lidario.families.base import Decoder, Samples
from lidario.revolution.partial import PartialRevolution, part_of
from lidario.revolution.together import joined
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Arrival, Packets
from lidario.wire.formats import StreamFormat


def dated_within(
    packets: Packets,
    offsets: Sequence[int],
    ends: Sequence[int],
    partial: PartialRevolution,
    decoder: Decoder,
    wire: StreamFormat,
    sample_ns: float,
) -> Packets:
    """The same packets, dated also where revolutions end in a read that holds several of these ends.

    Args:
        packets: The packets.
        offsets: Where each of them begins (`packet_offsets`).
        ends: How many of them come before the end of each revolution; ascending.
        partial: The revolution in the making, which the decoder has not seen yet.
        decoder: The decoder of the stream.
        wire: Their format.
        sample_ns: Nanoseconds a sample; 0 where that is not known, and then all has the time of its read.
    """
    found, begin, last_ns = list[Arrival](), 0, partial.last_ns
    # The rotor may have stopped since the decoder has seen it.
    follower, unseen = decoder.fork(), partial.runs.copy()
    for complete, at_ns in packets.arrivals:
        inside = ends[bisect_right(ends, begin) : bisect_left(ends, complete)]
        part = part_of(packets, begin, complete, offsets, wire, sample_ns)
        if len(inside) > 1 and not _is_whole(part, follower, wire, sample_ns):
            if unseen:
                follower.decode(joined(unseen), part.data[: part.blocks[0].size])
            samples = follower.decode(part, None)
            unseen = []
            if samples.certain and samples.gaps:
                behind = _measured_behind(samples, [place - begin for place in inside])
                # None of them was there at the read before.
                found += [
                    (place, max(last_ns, at_ns - round(count * sample_ns)))
                    for place, count in zip(inside, behind, strict=True)
                ]
        else:
            unseen.append(part)
        found.append((complete, at_ns))
        begin, last_ns = complete, at_ns
    return replace(packets, arrivals=tuple(found))


def _is_whole(packets: Packets, decoder: Decoder, wire: StreamFormat, sample_ns: float) -> bool:
    """Whether nothing is missing among packets. Mostly it is so, and the long way of decoding takes longer."""
    last, offsets = packets.count - 1, packet_offsets(packets.blocks)
    before = part_of(packets, 0, last, offsets, wire, sample_ns)
    return decoder.fork().decode_several(before, packets.data[offsets[last] :], [last], 0, None) is not None


def _measured_behind(samples: Samples, places: Sequence[int]) -> list[int]:
    """How many samples were measured from each place to the end, those that are missing too.

    Args:
        samples: What a read was decoded to.
        places: How many of its packets come before each.
    """
    before = [at for at, _ in samples.gaps]
    passed = list(accumulate([skipped for _, skipped in samples.gaps], initial=0))
    measured = [each + passed[bisect_left(before, each)] for each in samples.ends]
    return [measured[-1] - measured[place - 1] for place in places]
