"""From packets to whole revolutions.

The assembler keeps the packets of the revolution in the making as bytes, and reads only their headings. At the seam
it joins them, has them decoded in one go, and divides the samples exactly where the rotor passed the seam: the rest
of the packet that crosses it begins the next revolution. Then it builds one `Scan`.

It does not deliver the first, partial revolution; a revolution around a restart of the stream; one that lacks so
much that parts of two may have met in it; or one whose angles are not certain. All but the first are counted as
broken.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from lidario.families.base import Stream
from lidario.revolution.build import DatedRevolution, turned_by
from lidario.revolution.clock import several
from lidario.revolution.ended import EndedRevolution, share_past
from lidario.revolution.incoming import Clock
from lidario.revolution.late_reads import Ends
from lidario.revolution.partial import PartialRevolution, SampleArrays, part_of
from lidario.revolution.seam import Seam, Split
from lidario.revolution.sparse_speed import dated_angles
from lidario.revolution.stats import AssemblerStats
from lidario.revolution.steady import SteadyAssembler
from lidario.revolution.timing import first_sample_ns
from lidario.revolution.together import joined
from lidario.scans.scan import Scan
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets
from lidario.wire.formats import Headings

__all__ = ["Assembler", "AssemblerStats"]


class Assembler(SteadyAssembler):
    """Builds the scans of one stream.

    Args:
        stream: The stream, as its family described it.
        baudrate: Speed of the line in bits a second; 0 when bytes take no time.
        wall_offset_ns: Wall clock minus monotonic clock.
        stats: Counters to add to; fresh ones by default.
        clock: What dates the packets, as for `Incoming`.

    Attributes:
        incoming: Checks and dates the packets that come, and knows how long a sample takes.
        partial: The revolution in the making.
        ended: How many streams have ended.
        wall_offset_ns: Wall clock minus monotonic clock, for the scans to come.
    """

    def __init__(
        self,
        stream: Stream,
        baudrate: int = 0,
        wall_offset_ns: int = 0,
        stats: AssemblerStats | None = None,
        clock: Clock | None = None,
    ) -> None:
        super().__init__(stream, baudrate, wall_offset_ns, stats, clock)
        self._seam = Seam(stream.format.full_turn, stream.format.first_seam)
        self._most_ns, self._most_bytes = stream.most_ns, stream.most_bytes
        self._earlier_scans = self.stats.scans
        self._next_offset_deg: float | None = None
        self.ended: int = 0
        self._ended_at: tuple[Packets, int, int] | None = None
        # Whether some of the packets taken last have not been processed yet.
        self._under_way = False
        self._parts: tuple[int, ...] = ()  # how many sectors a revolution is divided into, as for `SectorAssembler`

    def set_zero_offset(self, degrees: float, *, behind: bool = False) -> None:
        """Add another zero-angle offset, clockwise degrees, from the next scan on, or from the one `behind` it."""
        self._next_offset_deg = degrees if behind else None
        if not behind:
            self._stream = replace(self._stream, zero_offset_deg=degrees)

    def add(self, event: Packets) -> list[Scan]:
        """Take the next packets of the stream; return the revolutions they completed, usually none."""
        return [scan for scans in self.ends(event) for scan in scans]

    def ends(self, event: Packets) -> Iterator[list[Scan]]:
        """As `add`, but yields one revolution or one block at a time.

        Packets left when it is closed behind its first step, or the stream is ended meanwhile, count as discarded.
        """
        taken = self.incoming.take(event, self._clock.usual_ns)
        return iter(()) if taken is None else self._ends_in(*taken)

    def _ends_in(self, packets: Packets, headings: Headings) -> Iterator[list[Scan]]:
        ended, count, kept, done, alone = self.ended, packets.count, 0, 0, 1
        self._under_way = True
        try:
            splits = self._seam.splits(headings, self.incoming.passing)
            offsets = packet_offsets(packets.blocks) if splits else ()
            # If each packet is a little ahead of the one before, gaps are looked for only if no block can be made.
            is_dated = self.incoming.passing is None
            late = self._times_of(splits, packets, kept, offsets) if splits and is_dated else {}
            while done < len(splits):
                # A revolution begun in pieces is ended in pieces, even if nobody reads sectors any more.
                by_blocks = not self._parts and self.partial.divided is None
                ending, at_once = splits[done:] if by_blocks else splits[done : done + 1], 1
                if not by_blocks:
                    if not is_dated:
                        late, is_dated = self._times_of(splits, packets, kept, offsets), True
                    kept = self._keep_until(ending[0].packet, packets, headings, kept, offsets, late)
                # All scans of a block have the same offset.
                if self._next_offset_deg is None:
                    block = self.add_block(packets, offsets, ending, kept, late)
                    if block:
                        kept, done = ending[-1].packet, done + len(ending)
                        self.partial.begun_ns = self.incoming.read_at(packets, kept)
                        yield block
                        if self.ended != ended:
                            return
                        continue
                    # Something is wrong in the block. End 1, 2, 4 … revolutions alone, then try a block again.
                    at_once, alone = alone, 2 * alone
                    if not is_dated:
                        late, is_dated = self._times_of(splits, packets, kept, offsets), True
                for split in ending[:at_once]:
                    kept = self._keep_until(split.packet, packets, headings, kept, offsets, late)
                    scan = self._end_at(packets, split, offsets)
                    yield [] if scan is None else [scan]
                    if self.ended != ended:
                        return
                done += len(ending[:at_once])
            kept = self._keep_until(count, packets, headings, kept, offsets, late)
        finally:
            self._under_way = kept < count
            self.stats.discarded_packets += count - kept

    def _keep_until(
        self, end: int, event: Packets, headings: Headings, begin: int, offsets: Sequence[int], late: Ends
    ) -> int:
        """Keep the packets from number `begin` on to before `end`, which is returned.

        They are kept in parts, divided at each silence in which a revolution is given up.
        """
        cuts, arrivals = [end], event.arrivals
        if arrivals[-1][1] - arrivals[0][1] > self._most_ns:
            # Before each silence, and behind the read after it.
            cuts = [
                at
                for (before, ended_ns), (behind, begun_ns) in pairwise(arrivals)
                if begun_ns - ended_ns > self._most_ns
                for at in (before, behind)
            ] + cuts
        for cut in cuts:
            if begin < cut <= end:
                part = event
                if cut - begin < event.count:
                    wire, sample_ns = self._stream.format, self.incoming.time.known_ns
                    part = part_of(event, begin, cut, offsets, wire, sample_ns, late.get(cut))
                self._keep(part, headings[begin:cut])
                begin = cut
        return end

    def _end_at(self, event: Packets, split: Split, offsets: Sequence[int]) -> Scan | None:
        """End the revolution at a split; the packets before it are kept already."""
        number = split.packet
        held, now = self.stats.unfinished_packets, self.incoming.read_at(event, number)
        self.partial.ended_ns = now
        self._ended_at = event, number, number + 1
        scan = self._end(split, event.data[offsets[number] : offsets[number + 1]])
        self._ended_at, self.partial.begun_ns = None, now
        if self._next_offset_deg is not None:
            self.set_zero_offset(self._next_offset_deg)
        self.stats.finish(held, delivered=scan is not None)
        self._keep_time()
        return scan

    def end(self) -> list[Scan]:
        """The stream has ended: discard the revolution in the making. Harmless when done before.

        Returns:
            The revolutions that were complete among packets that waited.
        """
        scans = list[Scan]()
        late, odd = self.incoming.end()
        if late is not None:
            if self._under_way:
                # The packets before them were not processed either.
                self.stats.discarded_packets += late[0].count
            else:
                scans = [scan for some in self._ends_in(*late) for scan in some]
        self.ended += 1
        if odd is not None:
            Assembler._keep(self, odd, ())
        self._discard()
        return scans

    def _discard(self) -> None:
        """Discard the revolution in the making; the packets missing in it are counted all the same."""
        # A single packet shows no gap.
        if self.stats.unfinished_packets > 1 and (packets := self.partial.packets()) is not None:
            self.stats.lost_packets += (self._decoded or self._decoder.decode(packets, None)).lost
        self._decoded = None
        self.stats.finish(self.stats.unfinished_packets, delivered=False)
        self.partial = PartialRevolution(whole=False)

    def _keep(self, packets: Packets, headings: Headings) -> None:  # noqa: ARG002 - for subclasses that divide it
        partial, (count, received_ns) = self.partial, packets.arrivals[-1]
        partial.runs.append(packets)
        partial.size += len(packets.data)
        self.stats.unfinished_packets += count
        if received_ns - partial.runs[0].arrivals[0][1] > self._most_ns or partial.size > self._most_bytes:
            # It will never end as it should. Time alone is no bound: peers and files set the times.
            if partial.whole:
                self.stats.break_scan()
            self._clock.restart()
            here = self._decoded = self._decoded or self._decoder.decode(joined(partial.runs), None)
            sample_ns, elapsed_ns = self._stream.sample_ns, received_ns - partial.runs[0].arrivals[0][1]
            if 2 * here.last.samples * sample_ns > max(0, elapsed_ns):
                # The rotor is slow or stands still: none passed unseen, and only time shows what is missing.
                missing = round(len(here.ends) * (elapsed_ns / (here.ends[-1] * sample_ns) - 1))
                self.stats.lost_packets += several(missing - here.lost)
                self._clock = self._new_clock()
            self._discard()

    def _end(self, split: Split, following: bytes) -> Scan | None:
        """End the revolution in the making before the packet `following`, and begin the next."""
        partial = self.partial
        self.partial: PartialRevolution = PartialRevolution(
            whole=not split.broken, moved=split.moved, seam=split.seam, carried_ns=partial.last_ns
        )
        ended = self._ended(partial, split, following)
        if ended is None:
            return None
        if split.broken or split.moved:
            # Only the first mark may rightly stand elsewhere. A false mark moves the seam, and the next moves it
            # back.
            is_first = not split.broken and self.stats.scans == self._earlier_scans
            if partial.whole and not (partial.moved or is_first):
                self.stats.break_scan()
            self._clock.restart(split.seam / self._stream.format.full_turn)
            return None
        if partial.seam is None:
            # No split began the first part of a stream: use the seam that ends it.
            partial.seam = split.seam
        return self._scan(ended)

    def _ended(self, partial: PartialRevolution, split: Split, following: bytes) -> EndedRevolution | None:
        """Decode a revolution, and carry the samples behind the seam over to the next; None if it has no sample."""
        packets = partial.packets()
        if packets is None:
            return None
        if self._clock.needs_speed:
            self._clock.learn_speed(dated_angles(self._stream.format, packets))
        carried, lost, revoked = partial.carried, partial.lost_behind_carried, 0
        room = 0 if carried is None else len(carried.angle)
        samples, self._decoded = self._decoded or self._decode(partial, packets, split, following, room), None
        known_ns = self.incoming.time.known_ns
        self.incoming.measure(samples, packets)
        if not known_ns and self.incoming.time.ns and self._ended_at is not None:
            self._date_end(partial, *self._ended_at[:2])
            packets = joined(partial.runs)
        self.stats.lost_packets += samples.lost
        self.partial.behind_gap = bool(samples.lost_behind) or not samples.certain
        lost += samples.lost
        here = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
        if carried is not None:
            here.begin_with(carried)
        each, close = samples.revoked
        if each and close:
            self.stats.lost_packets += each * close
            self._clock.forget_speed()
        if each and carried is not None:
            # The packet at its beginning was stretched over a gap, so its samples are not used.
            revoked, partial.carried = each, None
            lost += revoked
        crossed = room + samples.last.before_seam
        if crossed < len(here.angle):
            self.partial.carry(here.part(crossed), samples)
            lost -= samples.lost_behind
        elif samples.lost_behind and not split.broken:
            # Divide the gap at the seam by samples: one packet may hold a single sample, the next forty.
            behind = share_past(self._stream.format, following, split.seam) * samples.last.samples
            lost_behind = samples.lost_behind
            self.partial.lost_before = min(lost_behind, round(lost_behind * behind / samples.skipped_behind))
        gaps = partial.gaps(samples, room, crossed, revoked=bool(revoked)) if samples.gaps or lost else []
        arrays = here.part(room if revoked else 0, crossed)
        if not len(arrays.angle):
            return None
        return EndedRevolution(partial, packets, samples, arrays, lost, gaps, revoked)

    def _date_end(self, partial: PartialRevolution, event: Packets, number: int) -> None:
        """Date the end of the revolution that shows how long a sample takes; it ends before `number` of `event`.

        Its read may have brought the next revolutions too. How late that made it could not be told before.
        """
        if number and partial.runs:
            wire, run = self._stream.format, partial.runs[-1]
            last = part_of(event, number - 1, number, None, wire, self.incoming.time.ns)
            partial.runs[-1] = replace(run, arrivals=(*run.arrivals[:-1], (run.count, last.received_ns)))
            self.partial.carried_ns = partial.last_ns

    def _scan(self, ended: EndedRevolution) -> Scan | None:
        """Date a revolution and build its scan; None if it is not whole, or parts of two have met in it."""
        ended.told = bool(self._stream.sample_ns)
        ended.sample_ns = ended.samples.sample_ns or self.incoming.time.known_ns
        ended.start_ns = first_sample_ns(ended, self._byte_ns)
        if not ended.sample_ns:
            ended.sample_ns = ended.measured_sample_ns
            ended.start_ns = first_sample_ns(ended, self._byte_ns)
        ended.spanned_ns = ended.count * ended.sample_ns
        number = self.stats.scans + self.stats.missed_scans - self._told_unseen - (not ended.partial.whole)
        if not self._is_whole(ended, number):
            return None
        arrays, rpm = ended.arrays, ended.samples.last.reported_rpm
        arrays.angle = turned_by(arrays.angle, self._stream.zero_offset_deg)
        made = DatedRevolution(arrays, ended.start_ns, ended.spanned_ns, ended.revolution_ns, rpm, ended.gaps)
        # A gap across the seam lies in both revolutions; each has its own part.
        lost = ended.lost + ended.partial.lost_before - self.partial.lost_before
        return self._deliver(made, ended.sample_ns, lost)

    def _is_whole(self, ended: EndedRevolution, number: int) -> bool:
        """Count a revolution, and tell whether it makes a scan."""
        partial, packets, samples, wire = ended.partial, ended.packets, ended.samples, self._stream.format
        ended.spanned_ns += ended.missing_samples(gap_behind=self.partial.carried is None) * ended.sample_ns
        ordinary_ns = self._clock.usual_ns or ended.spanned_ns
        broken = ended.is_broken(wire, ordinary_ns)
        told = samples.lost + partial.lost_behind_carried + ended.revoked
        if self._told_seq is None and self._ended_at is not None:
            least_ns = ended.least_ns(wire, self._clock.usual_ns)
            # Angles hide whole revolutions, so the arrival of the packet behind it decides.
            if least_ns:
                behind = part_of(*self._ended_at, None, wire, self.incoming.time.known_ns)
                if behind.received_ns - ended.start_ns < least_ns:
                    return False
        if not partial.whole and wire.first_seam is None:
            # Only marks tell where revolutions begin, so the first part may be longer than one revolution.
            self._clock.restart()
        else:
            before = self.stats.all_packets - packets.count - told
            beginning = ended.beginning(wire, broken=broken, number=number, packets_before=before)
            passed = self._clock.follow(beginning)
            if (passed.unseen > 0 or self._clock.is_late) and not samples.fits:
                # Its angles do not fit the packets: the revolutions that passed unseen passed in it.
                broken = beginning.broken = True
            if passed.unseen < 0 and self._told_seq is None:
                return False
            ended.revolution_ns = math.nan if beginning.borrowed else beginning.revolution_ns
            self.stats.lost_packets += passed.lost
            self.stats.missed_scans += passed.unseen - min(passed.unseen, self._told_unseen)
        if partial.whole and broken:
            self.stats.break_scan()
        return partial.whole and not broken
