"""The clean path: the revolutions of an undisturbed stream that end together are decoded as one block.

Live, that is one revolution. A file, or a program that blocked its event loop, brings many at once. Decoding all
together costs little more than decoding one: most of the cost is in the calls of numpy, not in the samples. The
scans are views into the arrays of the block.

The result is the same, to the last bit, as when `Assembler` takes one revolution after the other. A possible gap,
restart or late arrival is not judged here: `add_block` then makes no scan. If it had decoded a single revolution,
`Assembler` uses these samples; with several, nothing has changed.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter

from lidario.families.base import Samples, Stream
from lidario.revolution.build import DatedRevolution, build_scan, turned_by
from lidario.revolution.clock import NOISE, Beginning, RevolutionClock
from lidario.revolution.ended import FALSE_PART, UNEVEN, hides_a_turn
from lidario.revolution.incoming import Clock, Incoming
from lidario.revolution.late_reads import Ends, ends_within
from lidario.revolution.partial import PartialRevolution, SampleArrays, part_of
from lidario.revolution.seam import Split
from lidario.revolution.stats import AssemblerStats
from lidario.revolution.timing import byte_ns_at, earliest_ns
from lidario.revolution.together import joined
from lidario.scans.scan import Scan
from lidario.wire.blocks import packet_offsets, some_blocks
from lidario.wire.events import Packets


class SteadyAssembler:
    """Builds the scans of one stream while nothing is missing in it; the base of `Assembler`."""

    def __init__(
        self,
        stream: Stream,
        baudrate: int,
        wall_offset_ns: int,
        stats: AssemblerStats | None,
        clock: Clock | None,
    ) -> None:
        self.stats: AssemblerStats = stats or AssemblerStats()
        self._stream, self._decoder = stream, stream.decoder
        self._byte_ns = byte_ns_at(baudrate)
        self.wall_offset_ns: int = wall_offset_ns
        self.incoming: Incoming = Incoming(stream, self.stats, clock)
        self._tell_time()
        self.partial: PartialRevolution = PartialRevolution(whole=False)
        self._clock = self._new_clock()
        # The number of the revolution that ends, if its sectors told it already, and how many before it were
        # counted as missing then.
        self._told_seq: int | None = None
        self._told_unseen = 0
        # The decoded samples of a revolution that turned out not to be steady.
        self._decoded: Samples | None = None

    def add_block(
        self, event: Packets, offsets: Sequence[int], splits: Sequence[Split], first: int, late: Ends
    ) -> list[Scan]:
        """Make the scans of all revolutions up to the last split, decoded at once; none if any may lack something.

        Args:
            event: The packets that came.
            offsets: Where each of them begins (`packet_offsets`).
            splits: Where revolutions end in it; at least one.
            first: The first packet of the event that was not kept yet.
            late: When revolutions ended, as `ends_within`, where packets are missing behind in the same read.
        """
        if not self._may_be_steady(splits, first):
            return []
        stream, partial, last = self._stream, self.partial, splits[-1].packet
        wire, runs = stream.format, partial.runs
        if last > first:
            runs = [*runs, part_of(event, first, last, offsets, wire, stream.sample_ns)]
        packets = joined(runs)
        before = packets.count - last
        ends = [before + split.packet for split in splits]
        room = 0 if partial.carried is None else len(partial.carried.angle)
        following = event.data[offsets[last] : offsets[last + 1]]
        if len(splits) > 1:
            seam = None if splits[0].marked else splits[0].seam
            decoder = self._decoder.fork()
            samples = decoder.decode_several(packets, following, ends, room, seam)
        else:
            # If it is not steady, `Assembler` ends it with the same samples.
            samples = self._decoded = self._decode(partial, packets, splits[0], following, room)
            decoder = self._decoder
        if samples is None or not samples.is_steady:
            return []
        reads = [(room + samples.ends[complete - 1], at_ns) for complete, at_ns in packets.arrivals]
        if last in late:
            reads[-1] = reads[-1][0], late[last]
        elif last > first:
            # The bytes behind the end of a revolution were there already when it came. So late was the end.
            complete, now = event.arrivals[bisect_left(event.arrivals, last, key=itemgetter(0))]
            reads[-1] = reads[-1][0] + wire.samples_in(some_blocks(event.blocks, last, complete)), now
        reads.insert(0, (room, partial.carried_ns))
        here = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
        if partial.carried is not None:
            here.begin_with(partial.carried)
        offsets = packet_offsets(packets.blocks)
        usual_ns = self._clock.usual_ns
        revolutions, last_ns = _dated(stream, here, samples, ends, reads, offsets, self._byte_ns, usual_ns)
        if not revolutions or not self._clock.is_followed(revolutions):
            return []
        self._decoder, self._decoded = decoder, None
        self.stats.unfinished_packets += last - first
        self._settle(revolutions, samples, ends[-1] - (ends[-2] if len(ends) > 1 else 0))
        self.partial = PartialRevolution(whole=True, seam=splits[-1].seam, behind_gap=False, carried_ns=last_ns)
        used = room + samples.revolutions[-1].before_seam
        if used < len(here.angle):
            self.partial.carried = here.part(used)
        self.incoming.time.add(samples.ends[-1], last_ns)
        scans = [self._deliver(each, stream.sample_ns, 0) for each in revolutions]
        self._keep_time()
        return scans

    def _times_of(self, splits: Sequence[Split], packets: Packets, kept: int, offsets: Sequence[int]) -> Ends:
        """When revolutions ended within reads with gaps (`ends_within`), from packet number `kept` on."""
        if not self._stream.timed:
            return {}
        ends_at = [split.packet for split in splits if split.packet >= kept]
        unseen, begin = (self.partial.runs, kept) if self._decoded is None else ([], ends_at[0])
        sample_ns, wire = self.incoming.time.known_ns, self._stream.format
        last_ns = self.partial.last_ns
        decoder, uneven = self._decoder, wire.samples > 1 and self.incoming.passing is None
        return ends_within(
            packets, begin, offsets, ends_at, unseen, last_ns, decoder, wire, sample_ns, uneven=uneven
        )

    def _may_be_steady(self, splits: Sequence[Split], first: int) -> bool:
        """Whether enough is known of the revolution in the making and the one before, and all seams are alike."""
        partial, marked, seam = self.partial, splits[0].marked, splits[0].seam
        sure = partial.whole and not (partial.moved or partial.behind_gap or partial.carried_packets)
        came = partial.runs or splits[0].packet > first
        if not (sure and came) or not self._stream.sample_ns or self._clock.last is None:
            return False
        for split in splits:
            # A mark that ended no revolution may have moved the seam, and the decoder takes only one seam.
            other_seam = not marked and split.seam != seam
            if split.broken or split.moved or split.marked != marked or other_seam:
                return False
        return True

    def _settle(self, revolutions: Sequence[DatedRevolution], samples: Samples, packets: int) -> None:
        """Remember revolutions by the last of them, which has so many `packets`, and count all of theirs."""
        stats, latest, decoded = self.stats, revolutions[-1], samples.revolutions[-1]
        self._clock.settle(
            Beginning(
                latest.start_ns,
                over=0.0,
                revolution_ns=latest.revolution_ns,
                packet_ns=latest.revolution_ns / decoded.packets,
                packets=packets,
                lost=0,
                broken=False,
                number=stats.scans + stats.missed_scans + len(revolutions) - 1,
                packets_before=stats.all_packets - packets,
                spanned_ns=latest.spanned_ns,
            )
        )
        stats.finish(stats.unfinished_packets, delivered=True)

    def _decode(
        self,
        ended: PartialRevolution,  # noqa: ARG002 - for subclasses that decode parts of it before
        packets: Packets,
        split: Split,
        following: bytes,
        room: int,
    ) -> Samples:
        """Decode all packets of a revolution, with `room` free elements before their samples."""
        seam = None if split.marked or split.broken else split.seam
        return self._decoder.decode(packets, None if split.broken else following, room, seam)

    def _deliver(self, made: DatedRevolution, sample_ns: float, lost: int) -> Scan:
        self.stats.resume(made.start_ns)
        seq = self.stats.scans + self.stats.missed_scans if self._told_seq is None else self._told_seq
        self.stats.scans += 1
        wall_ns = made.start_ns + self.wall_offset_ns
        return build_scan(self._stream, made, wall_ns=wall_ns, sample_ns=sample_ns, seq=seq, lost=lost)

    def _keep_time(self) -> None:
        """From now on use the sample time that was found."""
        if (sample_ns := self.incoming.time.ns) != self._stream.sample_ns:
            self._stream = replace(self._stream, sample_ns=sample_ns)
            self.incoming.use_time_of(self._stream)
            self._tell_time()
            # What the clock remembers was computed with the old sample time.
            self._clock = self._new_clock()

    def _tell_time(self) -> None:
        self._decoder.tell_time(self._stream.sample_ns, passes=self.incoming.is_live)

    def _new_clock(self) -> RevolutionClock:
        return RevolutionClock(1e9 * self._stream.slowest_turn_s, exact=self.incoming.is_exact)


def _dated(
    stream: Stream,
    here: SampleArrays,
    samples: Samples,
    ends: Sequence[int],
    reads: Sequence[tuple[int, int]],
    offsets: Sequence[int],
    byte_ns: float,
    usual_ns: float,
) -> tuple[list[DatedRevolution], int]:
    """Divide the samples among the revolutions, and date each by all reads of its packets.

    Args:
        stream: The stream.
        here: The samples, behind those that were carried over.
        samples: The decoded packets.
        ends: How many packets there are up to the end of each revolution.
        reads: How many samples were there after each read, and its time; first those that were carried over.
        offsets: Where packets begin.
        byte_ns: Nanoseconds that a byte takes on the line; 0 where it takes none.
        usual_ns: Time of the revolution before.

    Returns:
        The revolutions, and the arrival of their last packet. No revolutions if one came late, or took more or less
        time than its angles show: `Assembler` judges these.
    """
    sample_ns = stream.sample_ns
    turned = SampleArrays(turned_by(here.angle, stream.zero_offset_deg), here.distance, here.intensity)
    found: list[DatedRevolution] = []
    (there, at_ns), read = reads[0], 1
    room, begin, packet = there, 0, 0
    for end, (before_seam, _, turn, rpm) in zip(ends, samples.revolutions, strict=True):
        seam_at, stop = room + before_seam, room + samples.ends[end - 1]
        earliest = at_ns - (there - 1 - begin) * sample_ns if there > begin else math.inf
        while reads[read][0] < stop:
            there, at_ns = reads[read]
            earliest = min(earliest, at_ns - (there - 1 - begin) * sample_ns)
            read += 1
        there, at_ns = reads[read]
        read += there == stop
        there, at_ns = stop, at_ns - round((there - stop) * sample_ns)
        earliest = min(earliest, at_ns - (stop - 1 - begin) * sample_ns)
        wire_ns = (offsets[end] - offsets[packet]) / (end - packet) * byte_ns
        start_ns = earliest_ns(earliest, sample_ns, wire_ns)
        spanned_ns, turn_ns = (seam_at - begin) * sample_ns, turn * sample_ns
        if (
            hides_a_turn(at_ns - start_ns - spanned_ns, usual_ns, gap=False)
            or not FALSE_PART * turn_ns <= spanned_ns <= UNEVEN * turn_ns
            or start_ns - round(at_ns - spanned_ns) > NOISE * turn_ns
        ):
            return [], 0
        found.append(DatedRevolution(turned.part(begin, seam_at), start_ns, spanned_ns, turn_ns, rpm))
        begin, packet, usual_ns = seam_at, end, turn_ns
    return found, at_ns
