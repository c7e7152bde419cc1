"""Dates the revolutions that end in one read: after a blocked event loop, a read holds several.

Only the end of a read has a time. A packet before it in the same read was measured earlier, by the time of all that
was measured since: of the packets that came, and of those that are missing among them. If the missing ones were
left out, a revolution in a read of a second would seem to end too late by a tenth of what was lost, as if a
revolution had passed unseen.
"""

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
    """The same packets, with an arrival also at each end of a revolution, in reads that hold several of these ends.

    Args:
        packets: The packets.
        offsets: Where each of them begins (`packet_offsets`).
        ends: How many packets come before the end of each revolution; ascending.
        partial: The revolution in the making, which the decoder has not seen yet.
        decoder: The decoder of the stream.
        wire: The format of the packets.
        sample_ns: Nanoseconds a sample; 0 if unknown, and then every packet has the time of its read.
    """
    found, begin, last_ns = list[Arrival](), 0, partial.last_ns
    # The packets since the decoder's last revolution are decoded first: the rotor may have stopped meanwhile.
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
                # None of them had come with the read before, at `last_ns`.
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
    """Whether nothing is missing among packets, which is the usual case."""
    last, offsets = packets.count - 1, packet_offsets(packets.blocks)
    before = part_of(packets, 0, last, offsets, wire, sample_ns)
    return decoder.is_whole(before, packets.data[offsets[last] :])


def _measured_behind(samples: Samples, places: Sequence[int]) -> list[int]:
    """How many samples, with the missing ones, were measured from each place to the end of a read.

    Args:
        samples: The decoded packets of the read.
        places: The places, each as the number of packets before it.
    """
    before = [at for at, _ in samples.gaps]
    passed = list(accumulate([skipped for _, skipped in samples.gaps], initial=0))
    measured = [each + passed[bisect_left(before, each)] for each in samples.ends]
    return [measured[-1] - measured[place - 1] for place in places]
