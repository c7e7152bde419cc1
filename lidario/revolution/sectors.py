"""Parts of the revolution in the making, handed out as soon as the rotor has passed the end of each.

`SectorAssembler` is an `Assembler` that decodes the revolution piece by piece: each time the headings pass the end
of a sector, the packets up to there are decoded, by a decoder that goes on where the revolution before ended. Where
a packet lies across the end, its samples are divided as at the seam: by where the rotor stood. A packet that can
only be decoded together with the one behind it waits for that one.

When the revolution has ended, its scan is made of the same pieces, so that the sectors and the scan hold the same
samples. What is judged and counted is what the whole revolution tells. Where nothing was missing, that is the sum
of the pieces. Otherwise all packets of the revolution are decoded once more, with what was known at its beginning.

The number of a revolution is known only at its end, when the time tells how many passed unseen before it. A sector
needs it earlier; so it is found in the same way with what is known when the first sector is complete, and the scan
then keeps it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Final

from lidario.families.base import Samples, Stream
from lidario.measured import with_gaps
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.revolution.build import turned_by
from lidario.revolution.clock import NOISE, Beginning
from lidario.revolution.divided import (
    RETREAT_PART,
    ROUNDING,
    DividedRevolution,
    OpenSector,
    away_of,
    ends_of,
    join_pieces,
    sum_of,
)
from lidario.revolution.ended import share_before
from lidario.revolution.incoming import Clock
from lidario.revolution.partial import PartialRevolution, joined
from lidario.revolution.seam import Split
from lidario.revolution.timing import earliest_ns
from lidario.samples import read_only
from lidario.scan import Scan
from lidario.sector import Sector
from lidario.wire.blocks import Block, packet_offsets
from lidario.wire.copies import copy_of
from lidario.wire.events import Packets
from lidario.wire.formats import BEGINS, HEADING_MASK, Headings

MOST_PARTS: Final = 72
"""Sectors of 5 degrees: the narrowest packet of any format is not much narrower."""


class SectorAssembler(Assembler):
    """As `Assembler`; once it was told to divide revolutions, it hands out their sectors before."""

    _publish_sector: Callable[[int, Sector], None]

    def __init__(
        self,
        stream: Stream,
        baudrate: int = 0,
        wall_offset_ns: int = 0,
        stats: AssemblerStats | None = None,
        clock: Clock | None = None,
    ) -> None:
        super().__init__(stream, baudrate, wall_offset_ns, stats, clock)
        self._parts: tuple[int, ...] = ()
        self._divided: DividedRevolution | None = None
        self._usual_samples = self._by_speed_ns = 0.0
        self._ending: tuple[DividedRevolution, int] | None = None

    def divide(self, parts: Iterable[int], publish: Callable[[int, Sector], None]) -> None:
        """Hand out sectors from the next revolution on.

        Args:
            parts: How many sectors each revolution is divided into; several sizes at the same time, or none.
            publish: Called with how many sectors of its size a revolution has, and the sector.
        """
        self._parts, self._publish_sector = tuple(sorted(parts)), publish
        self._by_blocks = not self._parts

    @property
    def next_ns(self) -> float:
        """When the packet that completes the next sector arrives if it is not late; NaN where unknown."""
        here = self._divided
        if here is None or not self._usual_samples:
            return math.nan
        wire, sample_ns, each = self._stream.format, self._sample_time_ns, here.most_samples
        end = here.ends[here.at][0] if here.at < len(here.ends) else wire.full_turn
        # From the beginning of the last packet to the end of the sector.
        away = (end - here.passed) * self._usual_samples / wire.full_turn
        # Where packets hold a sample more or fewer, a whole number of them may be off by two samples.
        spare = ROUNDING if wire.shortest == wire.longest else 2 / each
        more = float(max(1, math.ceil(away / each - spare)) * each)
        if end == wire.full_turn and wire.shortest != wire.longest:
            # The last packet is as short as need be, and so is the first one of the next revolution.
            more = max(1.0, away - each + 1)
        if here.gap:
            return here.partial.last_ns + more * sample_ns
        return here.first_ns + (here.samples + more - 1) * sample_ns

    @property
    def keeps_offset(self) -> bool:
        """As `Assembler.keeps_offset`: where sectors of it may have been handed out."""
        return self._divided is not None and self._divided.partial is self.partial

    def set_zero_offset(self, degrees: float, *, behind: bool = False) -> None:
        """As `Assembler.set_zero_offset`; a revolution of which sectors were handed out keeps the one before."""
        super().set_zero_offset(degrees, behind=behind or self.keeps_offset)

    def end(self) -> None:
        super().end()
        self._divided = None

    # ------------------------------------------------------------------------------------------------ packets come

    def _keep(self, packets: Packets, headings: Headings) -> None:
        super()._keep(packets, headings)
        if not self._parts and self._divided is None:
            return
        if self._divided is None or self._divided.partial is not self.partial:
            self._divided = self._begin(int(headings[0]))
        if self._divided is not None:
            self._follow(self._divided, packets, headings)

    def _begin(self, first: int) -> DividedRevolution | None:
        """A revolution may begin with the packet of that heading; None where none does, or it is not divided."""
        partial, wire = self.partial, self._stream.format
        # Where the angles are not certain, samples that were carried over may still be dropped.
        sure = partial.whole and not partial.moved and not partial.carried_packets and len(partial.runs) == 1
        if not self._parts or not sure or partial.seam is None or not self._sample_time_ns:
            return None
        began = first & HEADING_MASK if first & BEGINS else partial.seam
        here = DividedRevolution(partial, began, self._decoder.fork(), self._stream.zero_offset_deg)
        here.ends = ends_of(wire.full_turn, self._parts)
        here.open = {count: OpenSector() for count in self._parts}
        if here.samples:
            here.first_ns = partial.carried_ns - (here.samples - 1) * self._sample_time_ns
            # The packet that crossed the seam ends where the first one begins, unless others are missing between.
            here.last_arc = (first - began) % wire.full_turn
            if here.gap and self._usual_samples:
                here.last_arc = here.samples * wire.full_turn / self._usual_samples
            if here.last_arc > wire.full_turn - wire.full_turn // RETREAT_PART:
                here.last_arc = 0.0
        return here

    def _follow(self, here: DividedRevolution, packets: Packets, headings: Headings) -> None:
        """Decode what these packets complete, and hand it out."""
        wire = self._stream.format
        here.date(packets, wire, self._sample_time_ns)
        full, ends = wire.full_turn, here.ends
        most = full - full // RETREAT_PART
        away = away_of(headings, here.began, full)
        offsets = packet_offsets(packets.blocks)
        begin = 0
        for number, angle in enumerate(away):
            # A reading that trembles back over the seam seems to be almost a revolution ahead.
            if 0 < angle - here.passed <= most:
                here.passed = angle
            if here.at == len(ends) or here.passed < ends[here.at][0]:
                continue
            if number > begin:
                here.waiting.append(self._part(packets, begin, number, offsets))
                here.waiting_at, begin = away[number - 1], number
            if here.waiting:
                self._take(here, packets.data[offsets[number] : offsets[number + 1]], here.passed)
            while here.at < len(ends) and ends[here.at][0] <= here.passed:
                self._pass_end(here)
        here.waiting.append(self._part(packets, begin, len(away), offsets) if begin else packets)
        here.waiting_at = away[-1]

    def _take(
        self, here: DividedRevolution, following: bytes | None, next_at: int, seam: int | None = None
    ) -> Samples:
        """Decode what waits: `following` is the packet behind it, and begins so far behind the seam."""
        room = 0 if here.rest is None else len(here.rest.angle)
        packets = joined(here.waiting)
        samples = here.decoder.decode(packets, following, room, seam)
        here.take(packets, samples, next_at, self._stream.format, self._sample_time_ns, self._clock.usual_ns)
        if samples.certain and samples.revolution_samples:
            self._usual_samples, self._by_speed_ns = samples.revolution_samples, samples.sample_ns
        return samples

    # ------------------------------------------------------------------------------------------------ sectors

    def _pass_end(self, here: DividedRevolution) -> None:
        """The rotor has passed the end of a sector: hand it out."""
        end, parts = here.ends[here.at]
        here.at += 1
        if here.rest is not None:
            here.give(here.upto(end))
        for count in parts:
            self._finish(here, count)

    def _finish(self, here: DividedRevolution, count: int) -> None:
        """A sector is complete: publish it, unless no sample of it came, or its angles may be wrong."""
        done = here.open[count]
        pieces = here.pieces[done.first :]
        if not pieces or not here.certain:
            # What is missing is told with the next one, whose index says that this one did not come.
            here.open[count] = OpenSector(done.index + 1, done.begin, done.lost, done.first)
            return
        here.open[count] = OpenSector(done.index + 1, here.given, here.lost, len(here.pieces))
        arrays = pieces[0] if len(pieces) == 1 else join_pieces(pieces)
        mode, wire, sample_ns = self._stream.mode, self._stream.format, self._sample_time_ns
        # When the first sample of the revolution was measured, as far as the packets so far tell.
        packet_bytes = here.bytes / here.packets if here.packets else wire.shortest
        start_ns = earliest_ns(here.first_ns, sample_ns, packet_bytes * self._byte_ns)
        if here.seq is None:
            here.seq = self._number(here, start_ns)
        lost = here.lost - done.lost
        before, gaps = done.begin, list[tuple[int, int]]()
        for at, skipped in here.gaps:
            if at <= done.begin:
                before += skipped
            elif at < here.given:
                gaps.append((at - done.begin, skipped))
        stamp_ns = start_ns + round(before * sample_ns)
        sector = Sector(
            device_angles=read_only(turned_by(arrays.angle, here.offset_deg)),
            device_distances=read_only(arrays.distance),
            intensities=None if arrays.intensity is None else read_only(arrays.intensity),
            stamp_ns=stamp_ns,
            wall_stamp_ns=stamp_ns + self.wall_offset_ns,
            time_increment_ns=round(sample_ns),
            duration_ns=round((len(arrays.angle) + sum([skipped for _, skipped in gaps])) * sample_ns),
            rpm=60e9 / (self._usual_samples * sample_ns) if self._usual_samples else math.nan,
            seq=here.seq,
            index=done.index,
            degrees=360.0 / count,
            dropped_before=0,
            lost_packets=lost,
            mode=mode.name,
            max_range=mode.max_distance,
            field_of_view=wire.field_deg,
        )
        self._publish_sector(count, with_gaps(sector, gaps) if lost else sector)

    @property
    def _sample_time_ns(self) -> float:
        time = self.incoming.time
        return self._by_speed_ns or time.ns or time.measured_ns

    def _number(self, here: DividedRevolution, start_ns: int) -> int:
        """The number of the revolution; those that passed unseen before it are counted."""
        stats, partial = self.stats, here.partial
        stats.resume(start_ns)
        if self._clock.last is not None and here.decoded:
            samples = here.decoded[0]
            over = share_before(self._stream.format, partial, samples) if partial.runs else 0.0
            turn_ns = samples.revolution_samples * self._sample_time_ns
            from_end_ns = round(partial.last_ns - (here.passed / self._stream.format.full_turn - over) * turn_ns)
            # A read that was completed only behind a gap dates what came before it too late, as in `beginning_of`.
            late = samples.certain and start_ns - from_end_ns > NOISE * turn_ns
            # A copy follows: at the end of the revolution more is known, and remembered.
            passed = copy_of(self._clock).follow(
                Beginning(
                    from_end_ns if late else start_ns,
                    over=over,
                    revolution_ns=turn_ns if samples.certain else 0.0,
                    revolution_packets=samples.revolution_packets,
                    packet_ns=0.0,
                    packets=here.packets,
                    lost=0,
                    broken=False,
                    number=stats.scans + stats.missed_scans,
                    packets_before=stats.all_packets - here.packets,
                )
            )
            here.unseen = max(0, passed.unseen)
            stats.missed_scans += here.unseen
        return stats.scans + stats.missed_scans

    # ------------------------------------------------------------------------------------------------ the end

    def _end(self, split: Split, following: bytes) -> Scan | None:
        self._told_seq, self._told_unseen = None, 0
        broken = self.stats.broken_scans
        scan = super()._end(split, following)
        ending, self._ending = self._ending, None
        if ending is not None:
            here, crossed = ending
            if here.seq is None and scan is not None:
                here.seq = scan.seq
            elif here.seq is None and self.stats.broken_scans > broken:
                # It has used a number up.
                here.seq = self.stats.scans + self.stats.missed_scans - 1
            if here.seq is not None:
                self._finish_all(here, crossed)
        return scan

    def _decode(
        self, ended: PartialRevolution, packets: Packets, split: Split, following: bytes, room: int
    ) -> Samples:
        here, self._divided = self._divided, None
        if here is None or here.partial is not ended:
            return super()._decode(ended, packets, split, following, room)
        wire = self._stream.format
        seam = None if split.marked or split.broken else split.seam
        behind = None if split.broken else following
        first = Packets(following, (Block(len(following), 1),), ((1, 0),))
        next_at = wire.full_turn + away_of(wire.headings(first), here.began, wire.full_turn)[0]
        left = 0 if here.rest is None else len(here.rest)
        crossed = left + self._take(here, behind, next_at, seam).before_seam
        samples = self._of_revolution(here, packets, behind, room, seam)
        if not (split.broken or split.moved):
            self._ending = here, crossed
        self._told_seq, self._told_unseen = here.seq, here.unseen
        return samples

    def _finish_all(self, here: DividedRevolution, crossed: int) -> None:
        """The revolution has ended: hand out its last sectors. Of the rest, so many samples belong to it."""
        assert here.rest is not None
        over = len(here.rest) - crossed
        if over:
            # The last packet reaches into the next revolution, and what is missing behind it belongs to that one.
            here.rest = here.rest.part(0, crossed)
            here.last_arc *= 1 - over / here.last_samples
            here.last_samples -= over
            here.lost_behind = 0
        while here.at < len(here.ends):
            self._pass_end(here)
        here.give(len(here.rest))
        for count in here.open:
            self._finish(here, count)

    def _of_revolution(
        self, here: DividedRevolution, packets: Packets, following: bytes | None, room: int, seam: int | None
    ) -> Samples:
        """What the whole revolution was decoded to: the samples of its pieces, and what they tell together."""
        pieces, arrays = here.decoded, here.rest
        assert arrays is not None
        if not here.certain:
            return self._decoder.decode(packets, following, room, seam)
        if here.pieces:
            arrays = join_pieces([*here.pieces, arrays])
        before_seam = sum([piece.ends[-1] for piece in pieces[:-1]]) + pieces[-1].before_seam
        if any(piece.lost or not piece.certain for piece in pieces):
            found = self._decoder.decode(packets, following, room, seam)
            # What its pieces could not know, as behind one sample alone, is told with the last sector.
            here.lost += max(0, found.lost - sum([piece.lost for piece in pieces]))
        else:
            self._decoder = here.decoder
            found = sum_of(pieces)
        found.angle_deg, found.distance_mm, found.intensity = arrays.angle, arrays.distance, arrays.intensity
        found.before_seam = before_seam
        return found
